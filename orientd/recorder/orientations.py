"""Orientations over time, out of whatever they were recorded in: MCAP, ROS 2 bags, csv.

Of our own recordings every cycle is taken, from ``/DEVICE/measured`` or ``/DEVICE/sent``.
Elsewhere a topic may hold anything with a quaternion in it, by the field names of Foxglove and of
ROS: poses, odometry, transforms, inertial measurements; as protobuf, JSON or ROS 2 messages.
"""

from __future__ import annotations

import csv
import json
import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from orientd.bounded_file import MEBIBYTE, check_regular
from orientd.recorder import bags
from orientd.recorder.reader import load_recording, messages, reading
from orientd.recorder.writer import RecordingError
from orientd.rotation import Floats
from orientd.stream import CycleFlag

_NESTS = ("pose", "transform", "odometry")
_NAMES = ("orientation", "rotation", "quaternion", "q")
_TIMES = {"time_s": 1.0, "time": 1.0, "t": 1.0, "timestamp": 1.0, "time_ns": 1e-9, "stamp": 1.0}
_FAR_APART = 1e3
"""s between two rows that nobody records: the numbers are in another unit."""
_DECODERS = ("mcap_protobuf.decoder", "mcap_ros2.decoder")


@dataclass(frozen=True, slots=True, eq=False)
class Orientations:
    """What a topic holds.

    Attributes:
        topic: its name.
        times: s, the first one 0, shape ``(n,)``.
        q: orientations ``(w, x, y, z)`` as they were found, shape ``(n, 4)``.
    """

    topic: str
    times: Floats
    q: Floats


def read_orientations(path: Path, topic: str = "") -> Orientations:
    """Return the orientations of a topic; of the one that is meant where none is named.

    Args:
        path: a .mcap or a .csv file, or a ROS 2 bag: its folder or its .db3 file.
        topic: in an MCAP file or a bag, the topic, with ``#CHILD`` for one frame where its
            transforms are of several; in a csv file, which has no topics, what stands before
            ``_qw`` or ``_w`` in the names of columns, if anything does.

    Raises:
        RecordingError: the file cannot be read, or has no such topic, or several.
    """
    with reading(path):
        if path.suffix == ".csv":
            tables = _from_csv(path)
        else:
            is_bag = bags.is_bag(path)
            tables = _from_bag(path) if is_bag else _from_ours(path) or _from_others(path)
    if not tables:
        raise RecordingError(f"{path}: no orientations in it")
    if topic and list(tables) == [""]:
        raise RecordingError(
            f"{path}: a csv file has no topics, and the only orientation in this one has no name "
            f"either: leave out {topic!r}"
        )
    frames = [name for name in tables if name.startswith(f"{topic}#")] if topic else []
    if len(frames) == 1 and topic not in tables:
        (topic,) = frames
    if topic and topic not in tables:
        raise RecordingError(f"{path}: no orientations in {topic!r}, there is {_listed(tables)}")
    name = topic if topic in tables else _meant(path, tables)
    times, q = tables[name]
    with np.errstate(invalid="ignore"):  # a time out of all range becomes no number
        return Orientations(name, times - (times[0] if len(times) else 0.0), q)


Tables = dict[str, tuple[Floats, Floats]]
Rows = dict[str, "array[float]"]
"""Time and orientation of each sample, one after the other, by topic."""


def _meant(path: Path, tables: Mapping[str, object]) -> str:
    """Return the topic that is meant where none is named: the only one, or what was measured."""
    names = list(tables)
    if len(names) > 1:
        names = [name for name in tables if name.split("/")[-1] == "measured"]
    if len(names) != 1:
        raise RecordingError(f"{path}: name one topic of {_listed(tables)}")
    return names[0]


def _listed(tables: Mapping[str, object]) -> str:
    return ", ".join(repr(name) if name else "one without a name" for name in tables)


def _from_ours(path: Path) -> Tables:
    try:
        recording = load_recording(path)
    except RecordingError:
        return {}
    tables: Tables = {}
    for device, cycles in recording.cycles.items():
        told = cycles[(cycles["flags"] & CycleFlag.FEEDBACK) != 0]
        if len(told):
            # A measurement that is read twice is one measurement.
            stamps, first = np.unique(told["feedback_time_ns"], return_index=True)
            tables[f"/{device}/measured"] = (stamps * 1e-9, told["measured_q"][first])
        written = cycles[(cycles["flags"] & CycleFlag.WRITTEN) != 0]
        if len(written):
            tables[f"/{device}/sent"] = (written["deadline_ns"] * 1e-9, written["sent_q"])
    return tables


def _from_others(path: Path) -> Tables:
    factories = [import_module(name).DecoderFactory() for name in _DECODERS]
    decoders: dict[int, Any] = {}
    rows: Rows = {}
    for channel, schema, message in messages(path):
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(channel, schema, factories)
        decode = decoders[channel.id]
        if decode is not None:
            _add(rows, channel.topic, message.log_time, decode(message.data))
    return _tables(rows)


def _from_bag(path: Path) -> Tables:
    rows: Rows = {}
    for topic, time, message in bags.messages(path):
        _add(rows, topic, time, message)
    return _tables(rows)


def _add(rows: Rows, topic: str, time_ns: int, message: object) -> None:
    """Add what a message has of orientations; *time_ns* counts where it has no time of its own."""
    for child, stamp, q in _orientations(message):
        name = f"{topic}#{child}" if child else topic
        rows.setdefault(name, array("d")).extend((time_ns * 1e-9 if stamp is None else stamp, *q))


def _tables(rows: Rows) -> Tables:
    tables: Tables = {}
    for name, found in rows.items():
        table = np.array(found).reshape(-1, 5)
        tables[name] = (table[:, 0], table[:, 1:])
    return tables


def _decoder(channel: Any, schema: Any, factories: Sequence[Any]) -> Any:  # noqa: ANN401 - of mcap
    if channel.message_encoding == "json":
        return json.loads
    found = (factory.decoder_for(channel.message_encoding, schema) for factory in factories)
    return next((decode for decode in found if decode is not None), None)


def _orientations(message: object) -> Iterator[tuple[str, float | None, tuple[float, ...]]]:
    """Yield child frame, time stamp and quaternion of everything in a message that has one."""
    many = _field(message, "transforms")
    if many is not None:
        for one in many:
            for _, stamp, q in _orientations(one):
                yield str(_field(one, "child_frame_id") or ""), stamp, q
        return
    found = _quaternion(message)
    if found is not None:
        yield "", _stamp(message), found


def _quaternion(message: object, depth: int = 0) -> tuple[float, ...] | None:
    parts = [_field(message, axis) for axis in "wxyz"]
    if all(isinstance(part, int | float) for part in parts):
        return tuple(float(part) for part in parts)
    if depth < 4:
        for name in (*_NAMES, *_NESTS):
            inner = _field(message, name)
            found = None if inner is None else _quaternion(inner, depth + 1)
            if found is not None:
                return found
    return None


def _stamp(message: object) -> float | None:
    header = _field(message, "header")
    holders = ((header, "stamp"), (message, "stamp"), (message, "timestamp"))
    for holder, name in holders:
        stamp = None if holder is None else _field(holder, name)
        if stamp is None:
            continue
        if isinstance(stamp, int | float):
            return float(stamp)
        seconds = next((s for n in ("sec", "seconds") if (s := _field(stamp, n)) is not None), None)
        rest = next(
            (s for n in ("nanosec", "nanos", "nsec") if (s := _field(stamp, n)) is not None), 0
        )
        if seconds is not None and (seconds or rest):
            return float(seconds) + 1e-9 * float(rest)
    return None


def _field(message: object, name: str) -> Any:  # noqa: ANN401 - whatever a message holds
    if isinstance(message, Mapping):
        return message.get(name)
    return getattr(message, name, None)


_LONGEST_ROW = MEBIBYTE
"""Bytes of a row of a table; of a wide one, some thousand."""


def _from_csv(path: Path) -> Tables:
    check_regular(path)
    with path.open(newline="", encoding="utf-8-sig") as stream:
        lines = _Lines(path, stream)
        rows = csv.reader(lines)
        header = [name.strip() for name in next(rows, [])]
        places = {name: place for place, name in enumerate(header)}
        clock = next((name for name in _TIMES if name in places), None)
        if clock is None:
            raise RecordingError(f"{path}: no column of times; expected {', '.join(_TIMES)}")
        found = list(_quaternion_columns(header, places))
        used = {clock, *(name for _, q, own in found for name in (*q, *own))}
        read = {name: array("d") for name in used}
        for row in rows:
            lines.begin_row()
            if row:
                for name, column in read.items():
                    column.append(_number(row, places[name]))
    columns = {name: np.array(column) for name, column in read.items()}
    times = columns[clock] * _TIMES[clock]
    apart = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if apart > _FAR_APART:
        raise RecordingError(
            f"{path}: the column {clock!r} is in seconds, and rows are {apart:g} s apart; "
            "call it 'time_ns' if it holds nanoseconds"
        )
    return {
        topic: (
            columns[own[0]] if own else times,
            np.stack([columns[name] for name in q], axis=-1),
        )
        for topic, q, own in found
    }


def _quaternion_columns(
    header: Sequence[str], places: Mapping[str, int]
) -> Iterator[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Yield topic, columns of the quaternion and, where it has one, that of its own times."""
    for name in header:
        if not name.endswith("w"):
            continue
        prefix = name[:-1]
        if all(prefix + axis in places for axis in "xyz"):
            topic = prefix.removesuffix("q").rstrip("_.")
            own = f"{topic}_time_s"
            q = tuple(prefix + axis for axis in "wxyz")
            yield topic, q, ((own,) if own in places else ())


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


def _number(row: Sequence[str], place: int) -> float:
    try:
        number = float(row[place])
    except (ValueError, IndexError):
        return math.nan
    return number if math.isfinite(number) else math.nan
