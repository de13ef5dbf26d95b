"""Reads recordings back: cycles, events, settings; also of a file whose end is missing."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdError

from orientd.recorder import recording_pb2
from orientd.recorder.cycle_table import CYCLES, Table, from_block
from orientd.recorder.writer import RecordingError
from orientd.rpc import control_pb2 as pb

_CYCLES = recording_pb2.CycleBlock.DESCRIPTOR.full_name
_EVENT = pb.Event.DESCRIPTOR.full_name
_STATE = pb.GetStateResponse.DESCRIPTOR.full_name


@dataclass(eq=False)
class Recording:
    """What a file holds.

    Attributes:
        cycles: of every device, in order, by name.
        events: of all devices, in order.
        states: what the daemon said of itself and its devices.
        facts: the metadata ``orientd``.
        configuration: the daemon's settings.
        offset_ns: from the monotonic clock to the time of day.
        is_complete: whether the file has its end.
    """

    cycles: dict[str, Table] = field(default_factory=dict)
    events: list[pb.Event] = field(default_factory=list)
    states: list[pb.GetStateResponse] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
    configuration: dict[str, Any] = field(default_factory=dict)
    offset_ns: int = 0
    is_complete: bool = True

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


def load_recording(path: Path) -> Recording:
    """Read a recording of ours.

    Raises:
        RecordingError: it cannot be read, or is not one of ours.
    """
    recording = Recording()
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    blocks: dict[str, list[Table]] = {}
    for record in records(path, recording):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata) and record.name == "orientd":
            recording.facts = dict(record.metadata)
            recording.offset_ns = int(recording.facts["clock_offset_ns"])
        elif isinstance(record, Attachment) and record.name == "configuration.json":
            recording.configuration = json.loads(record.data)
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            kind = schemas[channel.schema_id].name if channel.schema_id else ""
            if kind == _CYCLES:
                device = channel.topic.split("/")[1]
                block = recording_pb2.CycleBlock.FromString(record.data)
                blocks.setdefault(device, []).append(from_block(block))
            elif kind == _EVENT:
                recording.events.append(pb.Event.FromString(record.data))
            elif kind == _STATE:
                recording.states.append(pb.GetStateResponse.FromString(record.data))
    if not recording.facts:
        raise RecordingError(f"{path}: not a recording of orientd")
    for device, tables in blocks.items():
        recording.cycles[device] = np.concatenate(tables) if tables else np.zeros(0, dtype=CYCLES)
    recording.events.sort(key=lambda event: event.time_ns)
    return recording


def records(path: Path, recording: Recording | None = None) -> Iterator[McapRecord]:
    """Yield every record of an MCAP file, those inside chunks too; a missing end is no error.

    Args:
        path: of the file.
        recording: is told where the end is missing.

    Raises:
        RecordingError: the file cannot be read, or is no MCAP file.
    """
    is_complete = False
    try:
        with path.open("rb") as stream:
            if stream.seek(0, os.SEEK_END) > 2 * len(MCAP0_MAGIC):
                stream.seek(-len(MCAP0_MAGIC), os.SEEK_END)
                is_complete = stream.read() == MCAP0_MAGIC
            stream.seek(0)
            if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise RecordingError(f"{path}: not an MCAP file")
            stream.seek(0)
            if recording is not None:
                recording.is_complete = is_complete
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    yield from breakup_chunk(record, validate_crc=True)
                else:
                    yield record
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    except (McapError, ValueError, struct.error, ZstdError) as error:
        if is_complete:
            raise RecordingError(f"{path}: a damaged MCAP file: {error}") from error
