"""Read orientations from text: csv tables with column names (also EuRoC), TUM trajectories.

Times are read digit by digit, as whole nanoseconds: a double of the time of day has steps of
hundreds of them.
"""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TextIO

import numpy as np

from orientd.bounded_file import MEBIBYTE, check_regular
from orientd.one_line import one_line
from orientd.recorder.samples import NO_TIME, Samples
from orientd.recorder.writer import RecordingError

TUM_ENDINGS = (".tum", ".txt")
"""Of files with `timestamp tx ty tz qx qy qz qw` in each line."""

_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Powers of ten, in nanoseconds."""
_TIMES = {"time_s": "s", "time": "s", "t": "s", "timestamp": "s", "time_ns": "ns", "stamp": "s"}
_HEADING = re.compile(r"#?\s*([^\[\]]*?)\s*(?:\[([^\]]*)\])?\s*")
"""A name and, in brackets, its unit, as EuRoC has them."""
_NO_SECONDS = 10**17
"""A whole number of seconds from here on is one of nanoseconds."""
_FAR_APART = 1e3
"""Seconds between two rows beyond which the times must be in another unit."""
_LATEST = 2**62
_SHOWN = 40
"""Most characters of a word in an error."""
_LONGEST_ROW = MEBIBYTE
"""Bytes of a row of a table; of a wide one, some thousand."""


Row = tuple[int, list[str]]
"""Number of the line that a row ends in, and its words."""


def read_table(path: Path) -> dict[str, Samples]:
    """Return the orientations of a csv file or a TUM trajectory, by the common part of the names.

    Raises:
        RecordingError: there is no column of times, it is in another unit, or a TUM trajectory does
            not have eight numbers in its first line.
        OSError: the file cannot be read.
    """
    check_regular(path)
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        lines = _Lines(path, stream)
        rows = _tum_rows(path, lines) if path.suffix in TUM_ENDINGS else _csv_rows(path, lines)
        _, names = next(rows, (0, []))
        header = [_HEADING.fullmatch(name) for name in names]
        places = {match[1]: place for place, match in enumerate(header) if match}
        clock = next((name for name in _TIMES if name in places), None)
        if clock is None:
            raise RecordingError(f"{path}: no column of times; expected {', '.join(_TIMES)}")
        said = header[places[clock]]
        unit = (said[2] if said else None) or _TIMES[clock]
        if unit not in _UNITS:
            raise RecordingError(
                f"{path}: the column {clock!r} is in {unit!r}; expected {', '.join(_UNITS)}"
            )
        found = list(_quaternion_columns(places))
        clocks = {name: array("q") for name in {clock, *(own for _, _, own in found if own)}}
        read = {name: array("d") for name in {name for _, q, _ in found for name in q}}
        numbers, given = array("q"), array("d")
        wrong: dict[str, tuple[int, str]] = {}
        for number, row in rows:
            given.append(_number(row, places[clock]))
            if not numbers and unit == "s" and given[0] >= _NO_SECONDS:
                unit = "ns"
            numbers.append(number)
            for name, instants in clocks.items():
                instants.append(_nanoseconds(row, places[name], _UNITS[unit]))
                if instants[-1] == NO_TIME:
                    wrong.setdefault(name, (number, _word(row, places[name])))
            for name, column in read.items():
                column.append(_number(row, places[name]))
                if math.isnan(column[-1]):
                    wrong.setdefault(name, (number, _word(row, places[name])))
    columns = {name: np.array(column) for name, column in read.items()}
    stamps = {name: np.array(instants, dtype=np.int64) for name, instants in clocks.items()}
    apart = float(np.median(np.diff(given))) if len(numbers) > 1 else 0.0
    if unit == "s" and apart > _FAR_APART:
        raise RecordingError(
            f"{path}: the column {clock!r} is in seconds, and rows are {apart:g} s apart; "
            "call it 'time_ns' if it holds nanoseconds"
        )
    return {
        topic: Samples(
            stamps[own or clock],
            np.stack([columns[name] for name in q], axis=-1),
            f"the times in {own or clock!r}",
            np.array(numbers, dtype=np.int64),
            _first_words(wrong, (own or clock, *q)),
        )
        for topic, q, own in found
    }


def _csv_rows(path: Path, lines: _Lines) -> Iterator[Row]:
    """Yield the names of the columns, and the rows that are not empty."""
    rows = csv.reader(lines)
    try:
        for row in rows:
            lines.begin_row()
            if row:
                yield rows.line_num, row
    except csv.Error as error:
        raise RecordingError(
            f"{path}: line {rows.line_num} is no row of a table: {error}"
        ) from error


def _tum_rows(path: Path, lines: _Lines) -> Iterator[Row]:
    """Yield the names of the columns, which a comment may give in another order, and the rows."""
    names, is_begun = list(_TUM), False
    for number, line in enumerate(lines, 1):
        lines.begin_row()
        row = line.replace(",", " ").split()
        if not row:
            continue
        if row[0].startswith("#"):
            named = line.lstrip("# \t").replace(",", " ").split()
            names = named if sorted(named) == sorted(_TUM) else names
            continue
        if not is_begun and len(row) != len(_TUM):
            expected = f"expected {' '.join(_TUM)} in each line"
            raise RecordingError(f"{path}: {expected}, got {len(row)} words in line {number}")
        if not is_begun:
            is_begun = True
            yield 0, names
        yield number, row


def _quaternion_columns(
    places: Mapping[str, int],
) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield topic, columns of the quaternion and, if there is one, the column of its times."""
    for name in places:
        if not name.endswith("w"):
            continue
        prefix = name[:-1]
        if all(prefix + axis in places for axis in "xyz"):
            topic = prefix.removesuffix("q").rstrip("_.")
            own = f"{topic}_time_s"
            yield topic, tuple(prefix + axis for axis in "wxyz"), own if own in places else ""


class _Lines:
    """The lines of a file, as long as those of one row are no longer than a row may be."""

    def __init__(self, path: Path, stream: TextIO) -> None:
        self._path = path
        self._stream = stream
        self._room = _LONGEST_ROW

    def begin_row(self) -> None:
        self._room = _LONGEST_ROW

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        line = self._stream.readline(self._room)
        self._room -= len(line)
        if self._room <= 0:
            raise RecordingError(f"{self._path}: a row of more than {_LONGEST_ROW} characters")
        if not line:
            raise StopIteration
        return line


def _nanoseconds(row: Sequence[str], place: int, power: int) -> int:
    """Return a time in whole nanoseconds, of a text in units of ten to a *power* of them."""
    try:
        found = Decimal(row[place].strip()).scaleb(power)
        return round(found) if abs(found) < _LATEST else NO_TIME
    except (InvalidOperation, ValueError, OverflowError, IndexError):
        return NO_TIME


def _word(row: Sequence[str], place: int) -> str:
    return repr(one_line(row[place], _SHOWN)) if place < len(row) else "nothing"


def _first_words(wrong: Mapping[str, tuple[int, str]], names: Iterable[str]) -> str:
    """Return the first word under *names* that is no number, and the column."""
    found = [(*wrong[name], name) for name in names if name in wrong]
    if not found:
        return ""
    first = min(found, key=lambda one: one[0])
    return f"{first[1]} under {first[2]!r}"


def _number(row: Sequence[str], place: int) -> float:
    try:
        number = float(row[place])
    except (ValueError, IndexError):
        return math.nan
    return number if math.isfinite(number) else math.nan
