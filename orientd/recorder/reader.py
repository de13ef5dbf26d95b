"""Reads recordings back: cycles and events; of a cut or damaged one only where it is asked for."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import Channel, Message, Metadata, Schema

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.recorder import recording_pb2
from orientd.recorder.cycle_table import Table, from_block
from orientd.recorder.mcap_records import Damages, records
from orientd.recorder.writer import RecordingError
from orientd.stream import ServoState

_CYCLES = recording_pb2.CycleBlock.DESCRIPTOR.full_name
_EVENT = pb.Event.DESCRIPTOR.full_name

FEWEST_CYCLE_BYTES = 4
"""Of a file for each of its cycles, whose lateness alone takes two."""

_FREE_CYCLES = 50_000
_MOST_CYCLES_OF_BLOCK = 65_536


@dataclass(eq=False)
class Recording:
    """What of a file is read back.

    Attributes:
        cycles: of every device, in order, by name; of a cell ``DAEMON/DEVICE``.
        events: of all devices, in order.
        facts: the metadata ``orientd``.
        offset_ns: from the monotonic clock to the time of day.
        damages: what of the file cannot be read.
    """

    cycles: dict[str, Table] = field(default_factory=dict)
    events: list[pb.Event] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    offset_ns: int = 0
    damages: Damages = field(default_factory=Damages)

    @property
    def is_complete(self) -> bool:
        """Whether nothing of the file is missing."""
        return not self.damages

    def device(self, name: str = "") -> str:
        """Return the device called *name*; the only one where it is empty.

        Raises:
            RecordingError: there is none of that name, or there are several.
        """
        names = sorted(self.cycles)
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
    """Make a :class:`RecordingError` of whatever goes wrong with the content of *path*."""
    try:
        yield
    except OrientdError:
        raise
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    # What decoders of others make of damaged bytes is told nowhere.
    except Exception as error:
        text = " ".join(str(error).split())[:200]
        raise RecordingError(f"{path}: a damaged recording: {text or 'no message'}") from error


class NotOursError(RecordingError):
    """A recording that orientd has not written."""


def load_recording(path: Path, *, partial: bool = False) -> Recording:
    """Read a recording of ours.

    Args:
        path: of the file.
        partial: whether to take what is whole of a cut or damaged one.

    Raises:
        RecordingError: it cannot be read, is not one of ours, or is damaged.
    """
    with reading(path):
        return _load(path, partial=partial)


def _load(path: Path, *, partial: bool) -> Recording:
    recording = Recording()
    blocks: dict[str, list[Table]] = {}
    room = _FREE_CYCLES + path.stat().st_size // FEWEST_CYCLE_BYTES
    for channel, schema, message in messages(path, recording, partial=True):
        kind = schema.name if schema is not None else ""
        if kind == _CYCLES:
            device = channel.topic.rpartition("/")[0].removeprefix("/")
            block = recording_pb2.CycleBlock.FromString(message.data)
            room -= block.count
            if room < 0 or block.count > _MOST_CYCLES_OF_BLOCK:
                raise ValueError("more cycles than it has bytes for")
            blocks.setdefault(device, []).append(from_block(block))
        elif kind == _EVENT:
            recording.events.append(pb.Event.FromString(message.data))
    for device, tables in blocks.items():
        recording.cycles[device] = np.concatenate(tables)
    recording.events.sort(key=lambda event: event.time_ns)
    if recording.damages and not partial:
        raise _not_whole(path, recording)
    if not (recording.facts or (partial and recording.damages and recording.cycles)):
        raise NotOursError(f"{path}: not a recording of orientd")
    return recording


def _not_whole(path: Path, recording: Recording) -> RecordingError:
    words = "; ".join([recording.damages.told(), *_to_go(recording)])
    return RecordingError(
        f"{path} is not whole: {words}; `--partial` (in Python `partial=True`) takes what can be "
        "read"
    )


def _to_go(recording: Recording) -> Iterator[str]:
    """Yield how much of a motion is missing that ran when a recording was cut."""
    for device, cycles in recording.cycles.items() if recording.damages.is_cut else ():
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
        recording: is told what is missing, and what the file says of itself.
        partial: whether to leave it at what is whole of a cut or damaged file.

    Raises:
        OSError: the file cannot be read.
        RecordingError: it is no MCAP file, or, behind its last message, it is damaged.
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
            recording.offset_ns = int(recording.facts["clock_offset_ns"])
    if damages and not partial:
        raise _not_whole(path, recording)
