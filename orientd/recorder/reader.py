"""Reads recordings back: cycles and events; also of a file whose end is missing."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import get_frame_parameters

from orientd.bounded_file import MEBIBYTE, check_regular
from orientd.errors import OrientdError
from orientd.recorder import recording_pb2
from orientd.recorder.cycle_table import Table, from_block
from orientd.recorder.writer import RecordingError
from orientd.rpc import control_pb2 as pb

_CYCLES = recording_pb2.CycleBlock.DESCRIPTOR.full_name
_EVENT = pb.Event.DESCRIPTOR.full_name

LARGEST_CHUNK = 64 * MEBIBYTE
"""Of a file, once it is decompressed; others write chunks of a few MiB, or of one image."""

MOST_TIMES = 100
"""How many times as large as a file its chunks may become together, beyond the first
:data:`LARGEST_CHUNK`: what is much more was made to be so."""

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
        is_complete: whether the file has its end.
    """

    cycles: dict[str, Table] = field(default_factory=dict)
    events: list[pb.Event] = field(default_factory=list)
    facts: dict[str, str] = field(default_factory=dict)
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
        named = f"{type(error).__name__}: {text}" if text else type(error).__name__
        raise RecordingError(f"{path}: a damaged recording: {named}") from error


def load_recording(path: Path) -> Recording:
    """Read a recording of ours.

    Raises:
        RecordingError: it cannot be read, or is not one of ours.
    """
    with reading(path):
        return _load(path)


def _load(path: Path) -> Recording:
    recording = Recording()
    blocks: dict[str, list[Table]] = {}
    room = _FREE_CYCLES + path.stat().st_size // FEWEST_CYCLE_BYTES
    for channel, schema, message in messages(path, recording):
        if schema is None and channel.schema_id:
            raise ValueError(f"schema {channel.schema_id} is missing")
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
    if not recording.facts:
        raise RecordingError(f"{path}: not a recording of orientd")
    for device, tables in blocks.items():
        recording.cycles[device] = np.concatenate(tables)
    recording.events.sort(key=lambda event: event.time_ns)
    return recording


def messages(
    path: Path, recording: Recording | None = None
) -> Iterator[tuple[Channel, Schema | None, Message]]:
    """Yield the messages of an MCAP file, each with its channel and schema; see :func:`records`.

    Args:
        path: of the file.
        recording: is told where the end is missing, and what the file says of itself.
    """
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for record in records(path, recording):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            yield channel, schemas.get(channel.schema_id), record
        elif isinstance(record, Metadata) and record.name == "orientd" and recording is not None:
            recording.facts = dict(record.metadata)
            recording.offset_ns = int(recording.facts["clock_offset_ns"])


def records(path: Path, recording: Recording | None = None) -> Iterator[McapRecord]:
    """Yield every record of an MCAP file, those inside chunks too; a missing end is no error.

    Args:
        path: of the file.
        recording: is told where the end is missing.

    Raises:
        OSError: the file cannot be read.
        RecordingError: it is no MCAP file, or one whose chunks grow beyond all measure.
        Exception: whatever the decoder makes of damage; see :func:`reading`.
    """
    check_regular(path)
    is_complete = False
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        if size > 2 * len(MCAP0_MAGIC):
            stream.seek(-len(MCAP0_MAGIC), os.SEEK_END)
            is_complete = stream.read() == MCAP0_MAGIC
        stream.seek(0)
        if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
            raise RecordingError(f"{path}: not an MCAP file")
        stream.seek(0)
        if recording is not None:
            recording.is_complete = is_complete
        room = LARGEST_CHUNK + MOST_TIMES * size
        try:
            reader = StreamReader(stream, emit_chunks=True, record_size_limit=size)
            for record in reader.records:
                if not isinstance(record, Chunk):
                    yield record
                    continue
                grown = _grown(record)
                room -= grown
                if grown > LARGEST_CHUNK or room < 0:
                    raise RecordingError(f"{path}: a chunk becomes {grown / MEBIBYTE:.0f} MiB")
                yield from _inside(record)
        except RecordingError:
            raise
        except Exception:
            if is_complete:
                raise


def _grown(chunk: Chunk) -> int:
    """Return how large a chunk is once it is decompressed, as it says and as its content does."""
    if chunk.compression == "zstd":
        return max(chunk.uncompressed_size, get_frame_parameters(chunk.data).content_size)
    return max(chunk.uncompressed_size, len(chunk.data))


def _inside(chunk: Chunk) -> Iterator[McapRecord]:
    """Yield the records of a chunk one by one, where the library's own way makes a list of all."""
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    while stream.count < size:
        opcode, length = stream.read1(), stream.read8()
        if opcode == Opcode.CHANNEL:
            yield Channel.read(stream)
        elif opcode == Opcode.MESSAGE:
            yield Message.read(stream, length)
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(stream)
        else:
            stream.read(length)
