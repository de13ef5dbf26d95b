"""The records of an MCAP file, those of a cut or damaged one too, and what is missing of it.

A record is an opcode, a length and its content; most of a file are chunks, compressed, each with a
checksum.  A chunk whose content does not fit its checksum is left out.  Behind a record that cannot
be one, the next chunk that the index at the end of the file names is gone on from.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import get_frame_parameters

from orientd.bounded_file import MEBIBYTE, check_regular
from orientd.recorder.writer import RecordingError

LARGEST_CHUNK = 64 * MEBIBYTE
"""Of a file, once it is decompressed; others write chunks of a few MiB, or of one image."""

MOST_TIMES = 100
"""How many times as large as a file its chunks may become together, beyond the first
:data:`LARGEST_CHUNK`: what is much more was made to be so."""

_HEAD = 9  # bytes of an opcode and a length
_FOOTER = _HEAD + 20
_PRIVATE = 0x80  # opcodes from here on are of whoever wrote the file
_SHOWN = 3  # damaged places that are named

_KNOWN = frozenset(map(int, Opcode))
_READ: dict[int, Any] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.METADATA: Metadata.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.DATA_END: DataEnd.read,
    Opcode.FOOTER: Footer.read,
}
"""Of what has to be looked into; the others are for whoever seeks in a file."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a file that cannot be read.

    Attributes:
        first: its first byte in the file.
        count: how many bytes it has.
        begin_ns: time of the first message that is missing, as far as it is known.
        end_ns: of the last one; ``None`` where nobody knows.
    """

    first: int
    count: int
    begin_ns: int | None
    end_ns: int | None


@dataclass(slots=True)
class Damages:
    """What is missing of a file.

    Attributes:
        size: of the file, bytes.
        parts: that cannot be read, in their order.
        is_cut: whether data is missing at the end of the file.
        has_no_index: whether the data is whole, but what stands behind it is cut off.
        lost: messages that are missing besides, as the index says or as nothing says what they are.
        first_ns: time of the first message of the file.
        last_ns: of the last one that was read.
    """

    size: int = 0
    parts: list[Damage] = field(default_factory=list)
    is_cut: bool = False
    has_no_index: bool = False
    lost: int = 0
    first_ns: int | None = None
    last_ns: int | None = None

    def __bool__(self) -> bool:
        return bool(self.parts or self.is_cut or self.has_no_index or self.lost)

    def saw(self, time_ns: int) -> None:
        """Take note of the time of a message."""
        self.first_ns = time_ns if self.first_ns is None else min(self.first_ns, time_ns)
        self.last_ns = time_ns if self.last_ns is None else max(self.last_ns, time_ns)

    @property
    def reached(self) -> int | None:
        """Time of the last message that was read, or is known to be missing."""
        ends = [part.end_ns for part in self.parts[-1:]]
        return max((time for time in (self.last_ns, *ends) if time is not None), default=None)

    def told(self) -> str:
        """Return where the damage is and how much is missing, in one line."""
        words = [self._part(part) for part in self.parts[:_SHOWN]]
        if len(self.parts) > _SHOWN:
            words.append(f"{len(self.parts) - _SHOWN} more parts cannot be read")
        if self.is_cut:
            words.append(self._end())
        if self.lost:
            words.append(f"{self.lost} messages are missing besides")
        if self.has_no_index:
            words.append("the index behind its data is cut off")
        missing = sum(part.count for part in self.parts)
        spans = [(p.begin_ns, p.end_ns) for p in self.parts]
        seconds = sum(end - begin for begin, end in spans if begin is not None and end is not None)
        least = "at least " if self.is_cut or any(None in span for span in spans) else ""
        words.append(f"missing are {least}{1e-9 * seconds:.3f} s and {missing} bytes")
        return "; ".join(words)

    def _part(self, part: Damage) -> str:
        begin, end = self._seconds(part.begin_ns), self._seconds(part.end_ns)
        if part.begin_ns is None:
            place = "at its beginning"
        elif part.end_ns is None:
            place = f"from {begin} s on"
        else:
            place = f"from {begin} s to {end} s"
        return f"it cannot be read {place} ({part.count} bytes at byte {part.first})"

    def _end(self) -> str:
        if self.last_ns is None:
            return f"it has no end: nothing of its {self.size} bytes can be read"
        whole = self.size - (self.parts[-1].count if self.parts else 0)
        return (
            f"it has no end: it reaches to {self._seconds(self.last_ns)} s, {whole} bytes, and "
            "what was recorded after that is not there"
        )

    def _seconds(self, time_ns: int | None) -> str:
        known = time_ns is not None and self.first_ns is not None
        return f"{1e-9 * (time_ns - self.first_ns):.3f}" if known else "?"  # type: ignore[operator]


def records(path: Path, damages: Damages) -> Iterator[McapRecord]:
    """Yield every record of an MCAP file that can be read, those inside chunks too.

    Args:
        path: of the file.
        damages: is told what cannot be read.

    Raises:
        OSError: the file cannot be read.
        RecordingError: it is no MCAP file, or one whose chunks grow beyond all measure.
    """
    check_regular(path)
    with path.open("rb") as stream:
        size = damages.size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        magic = stream.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            if magic and MCAP0_MAGIC.startswith(magic):
                raise RecordingError(f"{path}: an MCAP file of which {size} bytes are left")
            raise RecordingError(f"{path}: not an MCAP file")
        summary = _summary(stream, size)
        # What a lost chunk said of its topics stands at the end once more.
        yield from (one for one in summary if isinstance(one, Schema | Channel))
        index = {one.chunk_start_offset: one for one in summary if isinstance(one, ChunkIndex)}
        begins = [one.message_start_time for one in index.values() if one.message_end_time]
        damages.first_ns = min(begins, default=None)
        seen = set()
        count, counted = 0, next((one for one in summary if isinstance(one, Statistics)), None)
        room = LARGEST_CHUNK + MOST_TIMES * size
        for record, offset, length in _top_level(stream, size, index, damages):
            seen.add(offset)
            if isinstance(record, Chunk):
                grown = _grown(record)
                room -= grown
                if grown > LARGEST_CHUNK or room < 0:
                    raise RecordingError(f"{path}: a chunk becomes {grown / MEBIBYTE:.0f} MiB")
                inside = _inside(record)
                if inside is None:
                    _lose(damages, index, offset, length, record)
                    continue
                found = inside
            else:
                found = iter((record,))
            try:
                for one in found:
                    if isinstance(one, Message):
                        damages.saw(one.log_time)
                        count += 1
                    yield one
            except (ValueError, LookupError, EOFError, McapError, struct.error):
                _lose(damages, index, offset, length)
        # What has become another record is a chunk all the same.
        ends = [(part.first, part.first + part.count) for part in damages.parts]
        for place in sorted(index.keys() - seen):
            if not any(first <= place < last for first, last in ends):
                _lose(damages, index, place, index[place].chunk_length)
        if counted is not None and not damages:
            damages.lost = max(counted.message_count - count, 0)


def _top_level(
    stream: IO[bytes], size: int, index: dict[int, ChunkIndex], damages: Damages
) -> Iterator[tuple[McapRecord, int, int]]:
    """Yield records that are outside of chunks, with place and size, up to the end of the data."""
    offset = len(MCAP0_MAGIC)
    while True:
        stream.seek(offset)
        head = stream.read(_HEAD)
        opcode, length = (head[0], int.from_bytes(head[1:], "little")) if head else (0, 0)
        is_one = opcode in _KNOWN or opcode >= _PRIVATE
        record: McapRecord | None = None
        if is_one and len(head) == _HEAD and offset + _HEAD + length <= size:
            content = stream.read(length)
            record = _record(opcode, content)
            if record is None and opcode in (*_READ, Opcode.MESSAGE):
                is_one = False
        else:
            is_one = False
        if not is_one:
            following = min((place for place in index if place > offset), default=None)
            if following is None:
                _lose_rest(stream, offset, size, index, damages)
                return
            _lose(damages, index, offset, following - offset)
            offset = following
            continue
        if record is not None:
            yield record, offset, _HEAD + length
        offset += _HEAD + length
        if opcode == Opcode.DATA_END:
            damages.has_no_index = not _has_end(stream, size)
            return


def _lose_rest(
    stream: IO[bytes], offset: int, size: int, index: dict[int, ChunkIndex], damages: Damages
) -> None:
    """Take note that from *offset* on nothing can be read."""
    damages.is_cut = not _has_end(stream, size)
    stream.seek(offset + _HEAD)
    times = stream.read(16)
    stream.seek(offset)
    begin, end = damages.reached, None
    if stream.read(1) == bytes([Opcode.CHUNK]) and len(times) == 16:
        # A chunk begins with the times of its first message and of its last one.
        first, last = (int.from_bytes(times[k : k + 8], "little") for k in (0, 8))
        if (begin or 0) <= last < (begin or first) + _LONGEST_CHUNK_NS:
            begin, end = begin if begin is not None else first, last
            damages.first_ns = begin if damages.first_ns is None else damages.first_ns
    if not damages.is_cut and index:
        end = max(one.message_end_time for one in index.values())
    if offset < size:
        damages.parts.append(Damage(offset, size - offset, begin, end))


_LONGEST_CHUNK_NS = 3_600_000_000_000
"""A chunk that says that it is longer has lost the bytes that say so."""


def _lose(
    damages: Damages,
    index: dict[int, ChunkIndex],
    offset: int,
    length: int,
    chunk: Chunk | None = None,
) -> None:
    """Take note that a part of the data cannot be read."""
    known: Any = [one for place, one in index.items() if offset <= place < offset + length]
    if not known and chunk is not None:
        known = [chunk]
    begin = damages.reached
    if begin is None:
        begin = min((one.message_start_time for one in known), default=None)
        damages.first_ns = begin if damages.first_ns is None else damages.first_ns
    end = max((one.message_end_time for one in known), default=begin)
    damages.parts.append(Damage(offset, length, begin, end))


def _has_end(stream: IO[bytes], size: int) -> bool:
    if size < len(MCAP0_MAGIC) + _FOOTER + len(MCAP0_MAGIC):
        return False
    stream.seek(size - len(MCAP0_MAGIC))
    return stream.read() == MCAP0_MAGIC


def _summary(stream: IO[bytes], size: int) -> list[McapRecord]:
    """Return what stands behind the data, as far as it can be read; nothing where it is cut off."""
    if not _has_end(stream, size):
        return []
    end = size - len(MCAP0_MAGIC) - _FOOTER
    stream.seek(end)
    footer = _record(Opcode.FOOTER, stream.read(_FOOTER)[_HEAD:])
    offset = footer.summary_start if isinstance(footer, Footer) else 0
    found: list[McapRecord] = []
    while len(MCAP0_MAGIC) < offset <= end - _HEAD:
        stream.seek(offset)
        head = stream.read(_HEAD)
        length = int.from_bytes(head[1:], "little")
        if offset + _HEAD + length > end:
            break
        record = _record(head[0], stream.read(length))
        if record is not None:
            found.append(record)
        offset += _HEAD + length
    return found


def _record(opcode: int, content: bytes) -> McapRecord | None:
    """Return a record; ``None`` where it is not looked into, or its content makes no sense."""
    found: McapRecord | None = None
    try:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.MESSAGE:
            found = Message.read(stream, len(content))
        elif opcode in _READ:
            found = _READ[opcode](stream)
    # What a decoder of others makes of damaged bytes is told nowhere.
    except Exception:  # noqa: BLE001
        return None
    return found


def _grown(chunk: Chunk) -> int:
    """Return how large a chunk is once it is decompressed, as it says and as its content does."""
    said = chunk.uncompressed_size
    if chunk.compression == "zstd":
        try:
            return max(said, get_frame_parameters(chunk.data).content_size)
        except Exception:  # noqa: BLE001 - damaged, which is seen again where it is decompressed
            return 0
    return max(said, len(chunk.data))


def _inside(chunk: Chunk) -> Iterator[McapRecord] | None:
    """Return the records of a chunk, which are made one by one; ``None`` where it is damaged."""
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    except Exception:  # noqa: BLE001 - as in _record
        return None
    return _each(stream, size)


def _each(stream: ReadDataStream, size: int) -> Iterator[McapRecord]:
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
