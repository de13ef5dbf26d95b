"""Read orientations from text: csv tables with column names (also EuRoC), TUM trajectories.

A table may have commas, semicolons, tabs or spaces between its columns, and decimal commas if
these are no commas.  Times are read digit by digit, as whole nanoseconds: a double of the time of
day has steps of hundreds of them.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TextIO

import numpy as np

from orientd.files import MEBIBYTE, check_regular
from orientd.one_line import counted, one_line
from orientd.recorder.writer import RecordingError
from orientd_replay.kinds import describe_kind
from orientd_replay.samples import NO_TIME, Samples

TUM_ENDINGS = (".tum", ".txt")
"""Of files with `timestamp tx ty tz qx qy qz qw` in each line."""

_TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
_UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Powers of ten, in nanoseconds."""
_TIMES = {
    # Of `rostopic echo -p`, which also has the time of arrival.
    "field.header.stamp": "ns",
    "time_s": "s", "time": "s", "t": "s", "timestamp": "s", "stamp": "s",
    "time_ms": "ms", "time_us": "us", "time_ns": "ns",
}  # fmt: skip
"""Names of columns of times, in any case, the better clock first, and their usual units."""
_HEADING = re.compile(r"[#%]?\s*([^\[\]()]*?)\s*(?:[\[(]([^\])]*)[\])])?\s*")
"""A name and, in brackets, its unit, as EuRoC has them."""
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
_COMMENT = ("#", "%")
_DELIMITERS = ("\t", ";", ",")
"""Between columns, the first one that the names have; a comma may also be in a number."""
_EXPECTED = "time_s,qw,qx,qy,qz"
_BOMS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Marks at the beginning of a file, the longer one first."""
_NO_SECONDS = 10**17
"""A whole number of seconds from here on is one of nanoseconds."""
_FAR_APART = 1e3
"""Seconds between two rows beyond which the times must be in another unit."""
_CLOSE = 1e-6
"""Seconds between two rows below which the times must be in another unit."""
_LATEST = 2**62
_SHOWN = 40
"""Most characters of a word in an error."""
_MOST_NAMES = 12
"""Most columns in an error."""
_LONGEST_ROW = MEBIBYTE
"""Bytes of a row of a table; of a wide one, some thousand."""


Line = tuple[int, str]
"""Number of a line, from 1, and its text."""
Row = tuple[int, list[str]]
"""Number of the line of a row, and its words."""


@dataclass(slots=True)
class _Table:
    """A table of text.

    Attributes:
        path: of the file.
        names: of the columns.
        rows: number of the line of each, and its words.
        has_commas: whether a comma may be the point of a number.
    """

    path: Path
    names: Sequence[str]
    rows: Iterator[Row]
    has_commas: bool


def read_table(path: Path) -> dict[str, Samples]:
    """Return the orientations of a csv file or a TUM trajectory, by the common part of the names.

    Raises:
        RecordingError: there is no column of times, no quaternion or no row, the times are in
            another unit, or the first line of a TUM trajectory is none.
        OSError: the file cannot be read.
    """
    check_regular(path)
    with path.open(newline="", encoding=_encoding(path), errors="replace") as stream:
        lines = _lines(path, stream)
        return _samples(_tum(path, lines) if path.suffix in TUM_ENDINGS else _csv(path, lines))


def _samples(table: _Table) -> dict[str, Samples]:
    header = [_HEADING.fullmatch(name) for name in table.names]
    headings = [
        match[1] if match else name for match, name in zip(header, table.names, strict=True)
    ]
    places = {name: place for place, name in enumerate(headings)}
    clocks_found = {name.lower(): name for name in reversed(headings) if name.lower() in _TIMES}
    clock = next((clocks_found[name] for name in _TIMES if name in clocks_found), None)
    found = list(_quaternion_columns(places))
    if clock is None or not found:
        what = "column of times" if clock is None else "quaternion"
        of_times = "" if clock is not None else f", or {', '.join(list(_TIMES)[1:])} for the times"
        came = ", ".join(one_line(name, _SHOWN) for name in headings[:_MOST_NAMES])
        more = ", ..." if len(headings) > _MOST_NAMES else ""
        raise RecordingError(
            f"{table.path}: no {what} in the columns {came}{more}; expected {_EXPECTED}{of_times}"
        )
    used = {clock, *(name for _, q, own in found for name in (*q, own) if name)}
    twice = next((name for name in headings if name in used and headings.count(name) > 1), None)
    if twice is not None:
        raise RecordingError(f"{table.path}: two columns are called {twice!r}; rename one")
    said = header[places[clock]]
    unit = (said[2] if said else None) or _TIMES[clock.lower()]
    if unit not in _UNITS:
        raise RecordingError(
            f"{table.path}: the column {clock!r} is in {unit!r}; expected {', '.join(_UNITS)}"
        )
    clocks = {name: array("q") for name in {clock, *(own for _, _, own in found if own)}}
    read = {name: array("d") for name in {name for _, q, _ in found for name in q}}
    numbers, given = array("q"), array("d")
    wrong: dict[str, tuple[int, str]] = {}
    for number, row in table.rows:
        words = _words(table, row)
        given.append(_number(words[places[clock]]) if words else math.nan)
        if not numbers and unit == "s" and given[0] >= _NO_SECONDS:
            unit = "ns"
        numbers.append(number)
        for name, instants in clocks.items():
            power = _UNITS[unit]
            instants.append(_nanoseconds(words[places[name]], power) if words else NO_TIME)
            if instants[-1] == NO_TIME and name not in wrong:
                wrong[name] = number, _cause(words, row, table, places[name])
        for name, column in read.items():
            column.append(_number(words[places[name]]) if words else math.nan)
            if math.isnan(column[-1]) and name not in wrong:
                wrong[name] = number, _cause(words, row, table, places[name])
    if not numbers:
        raise RecordingError(f"{table.path}: no rows below the names of the columns; add them")
    columns = {name: np.array(column) for name, column in read.items()}
    stamps = {name: np.array(instants, dtype=np.int64) for name, instants in clocks.items()}
    known = np.array(given)[~np.isnan(given)]
    apart = float(np.median(np.diff(known))) if len(known) > 1 else 0.0
    if unit == "s" and apart > _FAR_APART:
        raise RecordingError(
            f"{table.path}: the column {clock!r} is in seconds, and rows are {apart:g} s apart; "
            "call it 'time_ns' if it holds nanoseconds"
        )
    if unit != "s" and 0.0 < apart * 10.0 ** (_UNITS[unit] - 9) < _CLOSE:
        raise RecordingError(
            f"{table.path}: the column {clock!r} is in {unit}, and rows are {apart:.3g} {unit} "
            "apart; call it 'time_s' if it holds seconds"
        )
    return {
        topic: Samples(
            stamps[own or clock],
            np.stack([columns[name] for name in q], axis=-1),
            f"the times in {own or clock!r}",
            np.array(numbers, dtype=np.int64),
            _first(wrong, (own or clock, *q)),
        )
        for topic, q, own in found
    }


def _encoding(path: Path) -> str:
    """Return the encoding of a text, by its mark or, of ASCII in two bytes each, by its zeros."""
    with path.open("rb") as stream:
        head = stream.read(4)
    for mark, name in _BOMS.items():
        if head.startswith(mark):
            return name
    zeros = [byte == 0 for byte in head]
    if zeros == [False, True, False, True]:
        return "utf-16-le"
    return "utf-16-be" if zeros == [True, False, True, False] else "utf-8-sig"


def _lines(path: Path, stream: TextIO) -> Iterator[Line]:
    """Yield the lines that are not blank."""
    number = 0
    while line := stream.readline(_LONGEST_ROW):
        number += 1
        if len(line) == _LONGEST_ROW:
            raise RecordingError(f"{path}: a row of more than {_LONGEST_ROW} characters")
        if line.strip():
            yield number, line


def _csv(path: Path, lines: Iterator[Line]) -> _Table:
    """Return a table with names in its first line, or in a comment before it."""
    number, heading = next(filter(_is_heading, lines), (0, ""))
    heading = heading.lstrip("".join(_COMMENT)).strip(" \r\n")
    if _BINARY.search(heading):
        kind = describe_kind(path)
        more = f"; {kind}" if kind else ""
        raise RecordingError(f"{path}: no text; expected columns such as {_EXPECTED}{more}")
    if not heading:
        raise RecordingError(f"{path}: empty; expected columns such as {_EXPECTED}")
    delimiter = next((one for one in _DELIMITERS if one in heading), "")
    names = _split(heading, delimiter)
    while names and not names[-1].strip():
        names.pop()
    if not any(math.isnan(_number(word.replace(",", "."))) for word in names):
        raise RecordingError(
            f"{path}: line {number} has numbers, expected the names of the columns; put a "
            f"line such as {_EXPECTED} before it"
        )
    return _Table(path, names, _rows(path, lines, delimiter), has_commas=delimiter != ",")


def _is_heading(numbered: Line) -> bool:
    """Return whether a line is no comment, or one that names a time and a quaternion."""
    _, line = numbered
    if not line.startswith(_COMMENT):
        return True
    named = [word.lower() for word in re.split(r"[,;\s]+", line[1:].strip())]
    places = {name: place for place, name in enumerate(named)}
    return bool(places.keys() & _TIMES.keys() and list(_quaternion_columns(places)))


def _split(line: str, delimiter: str) -> list[str]:
    """Return the words of a line; without a delimiter, spaces are between them."""
    if not delimiter:
        return line.split()
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))


def _rows(path: Path, lines: Iterator[Line], delimiter: str) -> Iterator[Row]:
    """Yield the rows that are no comments."""
    for number, line in lines:
        if line.lstrip().startswith(_COMMENT):
            continue
        try:
            row = _split(line, delimiter)
        except csv.Error as error:
            raise RecordingError(f"{path}: line {number} is no row: {error}") from error
        if row[-1].endswith(("\n", "\r")):
            raise RecordingError(
                f"{path}: line {number} has a quote that another line closes, expected "
                "each row in one line; remove the quote"
            )
        yield number, row


def _tum(path: Path, lines: Iterator[Line]) -> _Table:
    """Return a trajectory, with its columns in another order if a comment names them so."""
    names = list(_TUM)
    spaced = ((number, line.replace(",", " ")) for number, line in lines)
    for number, line in spaced:
        row = line.split()
        if row[0].startswith(_COMMENT):
            named = line.lstrip("#% \t").split()
            names = named if sorted(named) == sorted(_TUM) else names
            continue
        if len(row) != len(_TUM) or math.isnan(_number(row[0])):
            raise RecordingError(
                f"{path}: line {number} is {one_line(line, _SHOWN)!r}; expected "
                f"{' '.join(_TUM)} in each line (a table with named columns ends in .csv)"
            )
        rows = itertools.chain([(number, row)], _rows(path, spaced, ""))
        return _Table(path, names, rows, has_commas=False)
    raise RecordingError(f"{path}: empty; expected {' '.join(_TUM)} in each line")


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


def _words(table: _Table, row: list[str]) -> list[str]:
    """Return the words of a row as numbers are written, none if they do not fit the columns."""
    count = len(table.names)
    if len(row) < count or any(word.strip() for word in row[count:]):
        return []
    return [word.replace(",", ".") for word in row] if table.has_commas else row


def _first(wrong: Mapping[str, tuple[int, str]], names: Iterable[str]) -> str:
    """Return the cause in the first of the lines, of its first column."""
    found = (wrong[name] for name in names if name in wrong)
    return min(found, key=lambda one: one[0], default=(0, ""))[1]


def _cause(words: Sequence[str], row: Sequence[str], table: _Table, place: int) -> str:
    """Return why a row has no number at *place*."""
    if not words:
        return f"{counted(len(row), 'field')} under {len(table.names)} columns"
    word = one_line(row[place], _SHOWN)
    return f"{word!r} under {table.names[place].strip()!r}, expected a number"


def _nanoseconds(word: str, power: int) -> int:
    """Return a time in whole nanoseconds, of a text in units of ten to a *power* of them."""
    try:
        found = Decimal(word.strip()).scaleb(power)
        return round(found) if abs(found) < _LATEST else NO_TIME
    except (ArithmeticError, ValueError):
        return NO_TIME


def _number(word: str) -> float:
    try:
        number = float(word)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan
