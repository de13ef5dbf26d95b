"""Read orientations from text: csv tables with column names (also EuRoC), TUM trajectories.

Times are read digit by digit, as whole nanoseconds: a double of the time of day has steps of
hundreds of them.
"""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import TextIO

import numpy as np

from orientd.bounded_file import MEBIBYTE, check_regular
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
"""Two rows so many seconds apart mean that the numbers are in another unit."""
_LATEST = 2**62
_LONGEST_ROW = MEBIBYTE
"""Bytes of a row of a table; of a wide one, some thousand."""


def from_csv(path: Path) -> dict[str, Samples]:
    """Return the orientations of a csv file, by the name that their columns have in common.

    Raises:
        RecordingError: there is no column of times, or it is in another unit.
        OSError: the file cannot be read.
    """
    check_regular(path)
    with path.open(newline="", encoding="utf-8-sig") as stream:
        lines = _Lines(path, stream)
        rows = csv.reader(lines)
        header = [_HEADING.fullmatch(name) for name in next(rows, [])]
        names = [match[1] if match else "" for match in header]
        places = {name: place for place, name in enumerate(names)}
        clock = next((name for name in _TIMES if name in places), None)
        if clock is None:
            raise RecordingError(f"{path}: no column of times; expected {', '.join(_TIMES)}")
        said = header[places[clock]]
        unit = (said[2] if said else None) or _TIMES[clock]
        if unit not in _UNITS:
            raise RecordingError(
                f"{path}: the column {clock!r} is in {unit!r}; expected {', '.join(_UNITS)}"
            )
        found = list(_quaternion_columns(names, places))
        clocks = {name: array("q") for name in {clock, *(own for _, _, own in found if own)}}
        read = {name: array("d") for name in {name for _, q, _ in found for name in q}}
        numbers, given = array("q"), array("d")
        for row in rows:
            lines.begin_row()
            if row:
                if not numbers and unit == "s":
                    unit = _unit(row, places[clock])
                numbers.append(rows.line_num)
                given.append(_number(row, places[clock]))
                for name, instants in clocks.items():
                    instants.append(_nanoseconds(row, places[name], _UNITS[unit]))
                for name, column in read.items():
                    column.append(_number(row, places[name]))
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
            np.array(numbers, dtype=np.int64),
        )
        for topic, q, own in found
    }


def from_tum(path: Path) -> dict[str, Samples]:
    """Return the orientations of a TUM trajectory: eight numbers in each line, in seconds.

    A comment that names the columns says whether w comes first or last.

    Raises:
        RecordingError: it is none.
        OSError: the file cannot be read.
    """
    check_regular(path)
    names: tuple[str, ...] = _TUM
    power = _UNITS["s"]
    times, components, numbers = array("q"), array("d"), array("q")
    with path.open(encoding="utf-8-sig") as stream:
        lines = _Lines(path, stream)
        for number, line in enumerate(lines, 1):
            lines.begin_row()
            row = line.replace(",", " ").split()
            if not row:
                continue
            if row[0].startswith("#"):
                named = tuple(line.lstrip("# \t").replace(",", " ").split())
                names = named if sorted(named) == sorted(_TUM) else names
                continue
            if not numbers and len(row) != len(_TUM):
                expected = f"expected {' '.join(_TUM)} in each line"
                raise RecordingError(f"{path}: {expected}, got {len(row)} words in line {number}")
            numbers.append(number)
            # A line that is cut off has no orientation.
            is_whole = len(row) == len(_TUM)
            clock = names.index("timestamp")
            if is_whole and len(numbers) == 1:
                power = _UNITS[_unit(row, clock)]
            times.append(_nanoseconds(row, clock, power) if is_whole else NO_TIME)
            components.extend(_number(row, names.index(f"q{axis}")) for axis in "wxyz")
    q = np.array(components).reshape(-1, 4)
    return {"": Samples(np.array(times, dtype=np.int64), q, np.array(numbers, dtype=np.int64))}


def _quaternion_columns(
    header: Sequence[str], places: Mapping[str, int]
) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield topic, columns of the quaternion and, where it has one, that of its own times."""
    for name in header:
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


def _unit(row: Sequence[str], place: int) -> str:
    """Return the unit of times in seconds, which may be nanoseconds, from the first of them."""
    return "ns" if place < len(row) and _number(row, place) >= _NO_SECONDS else "s"


def _nanoseconds(row: Sequence[str], place: int, power: int) -> int:
    """Return a time in whole nanoseconds, of a text in units of ten to a *power* of them."""
    try:
        found = Decimal(row[place].strip()).scaleb(power)
        return round(found) if abs(found) < _LATEST else NO_TIME
    except (InvalidOperation, ValueError, OverflowError, IndexError):
        return NO_TIME


def _number(row: Sequence[str], place: int) -> float:
    try:
        number = float(row[place])
    except (ValueError, IndexError):
        return math.nan
    return number if math.isfinite(number) else math.nan
