"""Read orientations over time from recordings: MCAP, ROS 2 bags, csv, TUM.

Recordings of orientd give every cycle, from ``/DEVICE/measured`` or ``/DEVICE/sent``.
In other files a topic may hold any message with a quaternion, by the field names of Foxglove and
ROS: poses, odometry, transforms, inertial measurements, as protobuf, JSON or ROS 2 messages.
"""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from orientd.one_line import one_line
from orientd.recorder.mcap_file import Damages, NotMcapError
from orientd.recorder.reader import (
    NotOursError,
    Recording,
    decoding,
    load_recording,
    messages,
    reading,
)
from orientd.recorder.writer import RecordingError
from orientd.rotation import Floats
from orientd.stream.records import CycleFlag
from orientd_replay import bags
from orientd_replay.kinds import EXPECTED, describe_kind
from orientd_replay.samples import NO_TIME, Samples, check_order, usable
from orientd_replay.text_tables import TUM_ENDINGS, read_table

_NESTS = ("pose", "transform", "odometry")
_NAMES = ("orientation", "rotation", "quaternion", "q")
_MOST_TOPICS = 12
"""Most topics in an error."""
_DECODERS = ("mcap_protobuf.decoder", "mcap_ros2.decoder")


@dataclass(frozen=True, slots=True, eq=False)
class Orientations:
    """The orientations of a topic.

    Attributes:
        topic: its name.
        times: s, the first one 0, exact to the nanosecond, NaN for a sample without one, shape
            ``(n,)``.
        q: orientations ``(w, x, y, z)``, scaled to norms of one, NaN for a norm below half or above
            twice the median, shape ``(n, 4)``.
        clock: what the times are, such as "the stamps of its messages".
        notes: one line for each irregularity of times, norms and the file.
    """

    topic: str
    times: Floats
    q: Floats
    clock: str
    notes: tuple[str, ...] = ()


def read_orientations(path: Path | str, topic: str = "", *, partial: bool = False) -> Orientations:
    """Return the orientations of a topic, by default of the only or the measured one.

    Args:
        path: a .mcap file, a .csv file (also of EuRoC), a TUM trajectory (.tum, .txt), or a ROS 2
            bag: its folder or its .db3 file.
        topic: of an MCAP file or a bag, with ``#CHILD`` for one frame of several.  In a csv file,
            the part of the column names before ``_qw`` or ``_w``.
        partial: whether to read a cut or damaged MCAP file as far as that goes, and to leave out
            damaged messages.

    Raises:
        RecordingError: the file cannot be read, has no such topic or several, is damaged, more than
            a tenth of the samples is unusable, or its clock was set back.
    """
    path = Path(path)
    damages = Damages()
    with reading(path):
        if path.suffix in (".csv", *TUM_ENDINGS):
            tables = read_table(path)
        elif path.is_dir() or path.suffix == ".db3":
            tables = _from_bag(path, damages, partial=partial)
        else:
            tables, damages = _from_mcap(path, partial=partial)
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
    samples = tables[name]
    q, norms = usable(path, samples)
    notes = (*([damages.describe()] if damages else []), *norms, *check_order(path, samples))
    return Orientations(name, samples.seconds(), q, samples.clock, notes)


Tables = dict[str, Samples]


@dataclass(slots=True)
class _Rows:
    """The samples of a topic, one after the other: ns of both clocks, and quaternions."""

    recorded: array[int] = field(default_factory=lambda: array("q"))
    stamps: array[int] = field(default_factory=lambda: array("q"))
    q: array[float] = field(default_factory=lambda: array("d"))


def _meant(path: Path, tables: Mapping[str, object]) -> str:
    """Return the topic to read by default: the only one, or the measured one."""
    names = list(tables)
    if len(names) > 1:
        names = [name for name in tables if name.split("/")[-1] == "measured"]
    if len(names) != 1:
        raise RecordingError(f"{path}: name one topic of {_listed(tables)} (`--topic`)")
    return names[0]


def _listed(tables: Mapping[str, object]) -> str:
    return ", ".join(repr(name) if name else "one without a name" for name in tables)


def _from_mcap(path: Path, *, partial: bool) -> tuple[Tables, Damages]:
    """Return the orientations in an MCAP file, and its damages."""
    try:
        recording = load_recording(path, partial=partial)
        if tables := _from_ours(recording):
            return tables, recording.damages
    except NotMcapError as error:
        kind = describe_kind(path)
        more = f"; {kind}" if kind else ""
        raise RecordingError(f"{path}: not an MCAP file; expected {EXPECTED}{more}") from error
    except NotOursError:
        pass  # of another program
    return _from_others(path, partial=partial)


def _from_ours(recording: Recording) -> Tables:
    tables: Tables = {}
    for device, cycles in recording.cycles.items():
        measured = cycles[(cycles["flags"] & CycleFlag.FEEDBACK) != 0]
        if len(measured):
            # A measurement that is read twice is one measurement.
            stamps, first = np.unique(measured["feedback_time_ns"], return_index=True)
            tables[f"/{device}/measured"] = Samples(
                stamps, measured["measured_q"][first], "the times of measurement"
            )
        written = cycles[(cycles["flags"] & CycleFlag.WRITTEN) != 0]
        if len(written):
            tables[f"/{device}/sent"] = Samples(
                written["deadline_ns"], written["sent_q"], "the deadlines"
            )
    return tables


def _from_others(path: Path, *, partial: bool) -> tuple[Tables, Damages]:
    factories = [import_module(name).DecoderFactory() for name in _DECODERS]
    recording = Recording(path=path)
    decoders: dict[int, Any] = {}
    rows: dict[str, _Rows] = {}
    kinds: dict[str, str] = {}
    for channel, schema, message in messages(path, recording, partial=partial):
        kinds[channel.topic] = schema.name if schema is not None else "without a schema"
        try:
            with decoding(path, channel.topic):
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(channel, schema, factories)
                decode = decoders[channel.id]
                content = None if decode is None else decode(message.data)
        except RecordingError as error:
            if not partial:
                raise RecordingError(f"{error}; {bags.LEAVE_OUT}") from error
            recording.damages.lost += 1
        else:
            _add(rows, channel.topic, message.log_time, content)
    return _tables(path, rows, kinds, recording.damages), recording.damages


def _from_bag(path: Path, damages: Damages, *, partial: bool) -> Tables:
    rows: dict[str, _Rows] = {}
    kinds: dict[str, str] = {}
    for topic, time, message in bags.messages(path, kinds, damages, partial=partial):
        _add(rows, topic, time, message)
    return _tables(path, rows, kinds, damages)


def _add(rows: dict[str, _Rows], topic: str, recorded_ns: int, message: object) -> None:
    """Add the orientations in a message, with the time of recording and its own stamp."""
    for child, stamp, q in _orientations(message):
        samples = rows.setdefault(f"{topic}#{child}" if child else topic, _Rows())
        samples.recorded.append(recorded_ns if abs(recorded_ns) < _LATEST else NO_TIME)
        samples.stamps.append(stamp)
        samples.q.extend(q)


def _tables(
    path: Path, rows: Mapping[str, _Rows], kinds: Mapping[str, str], damages: Damages
) -> Tables:
    """Return the samples of each topic.

    Raises:
        RecordingError: no topic has orientations.
    """
    if not rows:
        topics = ", ".join(
            f"{topic} ({kind})" for topic, kind in list(kinds.items())[:_MOST_TOPICS]
        )
        more = ", ..." if len(kinds) > _MOST_TOPICS else ""
        lost = f"; {damages.describe()}" if damages else ""
        if not kinds:
            raise RecordingError(
                f"{path}: no topics in it, expected one of orientations; record it again{lost}"
            )
        raise RecordingError(
            f"{path}: no orientations in its topics, {one_line(topics)}{more}; expected a field "
            f"orientation, rotation, quaternion or q with w, x, y, z{lost}"
        )
    return {name: _samples(found) for name, found in rows.items()}


def _samples(rows: _Rows) -> Samples:
    """Return the samples of a topic by one clock: their stamps, unless these were never set."""
    stamps = np.array(rows.stamps, dtype=np.int64)
    known = stamps[stamps != NO_TIME]
    q = np.array(rows.q).reshape(-1, 4)
    # Stamps that were never set are all the same, mostly 0.
    if (known != known[:1]).any():
        return Samples(stamps, q, "the stamps of its messages")
    return Samples(np.array(rows.recorded, dtype=np.int64), q, "the times of recording")


def _decoder(channel: Any, schema: Any, factories: Sequence[Any]) -> Any:  # noqa: ANN401 - of mcap
    if channel.message_encoding == "json":
        return json.loads
    found = (factory.decoder_for(channel.message_encoding, schema) for factory in factories)
    return next((decode for decode in found if decode is not None), None)


def _orientations(message: object) -> Iterator[tuple[str, int, tuple[float, ...]]]:
    """Yield child frame, time stamp and quaternion of each part of a message with a quaternion."""
    many = _field(message, "transforms")
    if many is None:
        parts: Iterable[object] = (message,)
    else:
        parts = many if isinstance(many, Iterable) else ()  # JSON may hold anything
    for part in parts:
        q = _quaternion(part)
        if q is not None:
            child = "" if many is None else str(_field(part, "child_frame_id") or "")
            yield child, _stamp(part), q


def _quaternion(message: object, depth: int = 0) -> tuple[float, ...] | None:
    parts = [_number(_field(message, axis)) for axis in "wxyz"]
    if None not in parts:
        return tuple(part for part in parts if part is not None)
    if depth < 4:
        for name in (*_NAMES, *_NESTS):
            inner = _field(message, name)
            found = None if inner is None else _quaternion(inner, depth + 1)
            if found is not None:
                return found
    return None


def _stamp(message: object) -> int:
    """Return the time stamp of a message, ns, :data:`NO_TIME` if it has none."""
    header = _field(message, "header")
    holders = ((header, "stamp"), (message, "stamp"), (message, "timestamp"))
    for holder, name in holders:
        stamp = None if holder is None else _field(holder, name)
        if stamp is None:
            continue
        if isinstance(stamp, int | float):
            return _nanoseconds(stamp, 0)
        seconds = next((s for n in ("sec", "seconds") if (s := _field(stamp, n)) is not None), None)
        rest = next(
            (s for n in ("nanosec", "nanos", "nsec") if (s := _field(stamp, n)) is not None), 0
        )
        if seconds is not None:
            return _nanoseconds(seconds, rest)
    return NO_TIME


def _nanoseconds(seconds: object, rest: object) -> int:
    """Return a time in whole nanoseconds, :data:`NO_TIME` if it is none."""
    if not (isinstance(seconds, int | float) and isinstance(rest, int | float)):
        return NO_TIME
    if not (abs(seconds) < _LATEST * 1e-9 and abs(rest) < _LATEST):
        return NO_TIME
    whole = seconds * 10**9 if isinstance(seconds, int) else 1e9 * seconds
    return round(whole + rest)


_LATEST = 2.0**61  # ns


def _number(value: object) -> float | None:
    try:
        return float(value) if isinstance(value, int | float) else None
    except OverflowError:
        return math.nan


def _field(message: object, name: str) -> Any:  # noqa: ANN401 - whatever a message holds
    if isinstance(message, Mapping):
        return message.get(name)
    return getattr(message, name, None)
