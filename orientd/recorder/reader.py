"""Read the cycles and events of a recording, on request also of a cut or damaged one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, Message, Metadata, Schema
from mcap_protobuf.decoder import DecoderFactory

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.recorder import earlier
from orientd.recorder.columns import SCHEMA_NAME, Layout, Table
from orientd.recorder.mcap_file import Damages, records
from orientd.recorder.writer import RecordingError
from orientd.stream.records import ServoState

_EVENT = pb.Event.DESCRIPTOR.full_name

_AT_ONCE = 4096
"""Messages that become a table together."""


@dataclass(eq=False)
class Recording:
    """The content of a recording.

    Attributes:
        cycles: of every device, in order, by name; of a cell ``DAEMON/DEVICE``.
        events: of all devices, in order.
        facts: the metadata ``orientd``.
        offset_ns: from the monotonic clock to the time of day.
        damages: how far the file can be read.
        path: of the file.
    """

    cycles: dict[str, Table] = field(default_factory=dict)
    events: list[pb.Event] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    offset_ns: int = 0
    damages: Damages = field(default_factory=Damages)
    path: Path = Path()

    @property
    def is_complete(self) -> bool:
        """Whether nothing of the file is missing."""
        return not self.damages

    def device(self, name: str = "") -> str:
        """Return the device called *name*, the only one if *name* is empty.

        Raises:
            RecordingError: there is none, none of that name, or there are several.
        """
        names = sorted(self.cycles)
        if not names:
            lost = f"; {self.damages.describe()}" if self.damages else ""
            raise RecordingError(f"{self.path}: no cycle of a device in it{lost}")
        if name in self.cycles:
            return name
        if name or len(names) != 1:
            came = repr(name) if name else "no name"
            raise RecordingError(f"device: expected one of {', '.join(names)}, got {came}")
        return names[0]

    def rate_hz(self, device: str) -> float:
        """Return a device's cycles a second."""
        rates = dict(pair.split("=") for pair in self.facts.get("rates_hz", "").split())
        if device in rates:
            return float(rates[device])
        return 1e9 / float(np.median(np.diff(self.cycles[device]["deadline_ns"])))


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn an error of the file *path* itself into a :class:`RecordingError`."""
    try:
        yield
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


@contextlib.contextmanager
def decoding(path: Path, part: str) -> Iterator[None]:
    """Turn each error of a decoder into a :class:`RecordingError` about *part* of the file."""
    try:
        yield
    except OrientdError:
        raise
    # The decoders do not document their exceptions for damaged bytes.
    except Exception as error:
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(f"{path}: {part} is damaged: {text}") from error


class NotOursError(RecordingError):
    """A recording that orientd has not written."""


def load_recording(path: Path | str, *, partial: bool = False) -> Recording:
    """Read a recording of orientd.

    Args:
        path: of the file.
        partial: whether to read a cut or damaged one as far as that goes.

    Raises:
        RecordingError: it cannot be read, is not of orientd, or is damaged.
    """
    path = Path(path)
    with reading(path):
        return _load(path, partial=partial)


class _Cycles:
    """Collects the cycles of a device, message by message.

    Args:
        path: of the file.
        topic: of the messages.
        schema: of the messages.
    """

    def __init__(self, path: Path, topic: str, schema: Schema) -> None:
        self._path = path
        self._topic = topic
        self._tables: list[Table] = []
        self._messages: list[bytes] = []
        is_block = schema.name == earlier.SCHEMA_NAME
        with decoding(path, topic):
            self._decode = DecoderFactory().decoder_for("protobuf", schema) if is_block else None
            self._layout = None if is_block else Layout(schema.data.decode())

    def add(self, message: bytes) -> None:
        """Add a message."""
        self._messages.append(message)
        if len(self._messages) >= _AT_ONCE:
            self._convert()

    def table(self) -> Table:
        """Return all of them, in their order."""
        self._convert()
        return np.concatenate(self._tables)

    def _convert(self) -> None:
        with decoding(self._path, self._topic):
            if self._decode is not None:
                for message in self._messages:
                    self._tables.append(earlier.cycles_of(self._decode(message), len(message)))
            elif self._layout is not None and self._messages:
                self._tables.append(self._layout.cycles(self._messages))
        self._messages = []


def _load(path: Path, *, partial: bool) -> Recording:
    recording = Recording(path=path)
    cycles: dict[str, _Cycles] = {}
    for channel, schema, message in messages(path, recording, partial=True):
        kind = schema.name if schema is not None else ""
        if schema is not None and kind in (SCHEMA_NAME, earlier.SCHEMA_NAME):
            device = channel.topic.rpartition("/")[0].removeprefix("/")
            if device not in cycles:
                cycles[device] = _Cycles(path, channel.topic, schema)
            cycles[device].add(message.data)
        elif kind == _EVENT:
            with decoding(path, channel.topic):
                recording.events.append(pb.Event.FromString(message.data))
    recording.cycles = {device: found.table() for device, found in cycles.items()}
    recording.events.sort(key=lambda event: event.time_ns)
    if recording.damages and not partial:
        raise _not_whole(path, recording)
    if not (recording.facts or (partial and recording.damages and recording.cycles)):
        raise NotOursError(
            f"{path}: not a recording of orientd; `orientd replay` and `orientd plot` read "
            "recordings of other programs"
        )
    return recording


def _not_whole(path: Path, recording: Recording) -> RecordingError:
    partial = "`--partial` (in Python `partial=True`) takes what can be read"
    words = recording.damages.describe(*_to_go(recording), partial)
    return RecordingError(f"{path} is not whole: {words}")


def _to_go(recording: Recording) -> Iterator[str]:
    """Yield the missing part of each motion that runs in the last cycle that can be read."""
    damages = recording.damages
    is_missing = damages.is_short and not damages.has_data
    for device, cycles in recording.cycles.items() if is_missing else ():
        last = cycles[-1]
        begun = [
            event
            for event in recording.events
            if event.device == device
            and event.kind == pb.EVENT_KIND_MOTION_STARTED
            and event.motion_number == last["motion"]
        ]
        if begun and last["state"] == ServoState.STREAMING:
            gone = 1e-9 * (int(last["deadline_ns"]) - begun[-1].time_ns)
            left = begun[-1].plan.certificate.duration - gone
            if left > 0.0:
                yield f"motion {last['motion']} of {device} was to go on for about {left:.3f} s"


def messages(
    path: Path, recording: Recording, *, partial: bool = False
) -> Iterator[tuple[Channel, Schema | None, Message]]:
    """Yield the messages of an MCAP file, each with its channel and schema.

    Args:
        path: of the file.
        recording: receives the damages and the facts.
        partial: whether to read a cut or damaged file as far as that goes.

    Raises:
        OSError: the file cannot be read.
        RecordingError: it is no MCAP file, or, after its last message, it is damaged.
    """
    damages = recording.damages
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in records(path, damages):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels.get(record.channel_id)
            if channel is None or (channel.schema_id and channel.schema_id not in schemas):
                damages.lost += 1
            else:
                yield channel, schemas.get(channel.schema_id), record
        elif isinstance(record, Metadata) and record.name == "orientd":
            recording.facts = dict(record.metadata)
            with decoding(path, "the metadata 'orientd'"):
                recording.offset_ns = int(recording.facts["clock_offset_ns"])
    if damages and not partial:
        raise _not_whole(path, recording)
