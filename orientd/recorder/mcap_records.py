"""Read the records of an MCAP file, also of a cut or damaged one, and say what is missing.

A record is an opcode, a length and its content.  Most of a file are compressed chunks, each with a
checksum.  A chunk that does not fit its checksum is left out.  After an unreadable record, reading
continues at the next chunk that the index at the end of the file names.
"""

from __future__ import annotations

import os
import struct
from bisect import bisect
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
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

from orientd.files import MEBIBYTE, check_regular
from orientd.one_line import counted
from orientd.recorder.writer import RecordingError

LARGEST_CHUNK = 64 * MEBIBYTE
"""Largest decompressed chunk; other programs write chunks of a few MiB, or of one image."""

MOST_TIMES = 100
"""Largest ratio of all decompressed chunks to the file, beyond the first :data:`LARGEST_CHUNK`."""

_HEAD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_FOOTER = _HEAD.size + 20
_PRIVATE = 0x80  # opcodes from here on belong to the program that wrote the file
_SHOWN = 3  # damaged places in a report

_READ: Mapping[int, Any] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.CHUNK: Chunk.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
    Opcode.CHUNK_INDEX: ChunkIndex.read,
    Opcode.STATISTICS: Statistics.read,
    Opcode.DATA_END: DataEnd.read,
    Opcode.FOOTER: Footer.read,
}
"""Records to decode; the others help programs that seek."""

_IGNORED = frozenset(map(int, Opcode)) - _READ.keys() - {Opcode.MESSAGE}


class NotMcapError(RecordingError):
    """A file of another kind."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a file that cannot be read.

    Attributes:
        first: its first byte in the file.
        count: how many bytes it has.
        begin_ns: time of the first missing message, if it is known.
        end_ns: of the last one, if it is known.
    """

    first: int
    count: int
    begin_ns: int | None
    end_ns: int | None


@dataclass(slots=True)
class Damages:
    """The parts of a file that are missing.

    Attributes:
        size: of the file, bytes.
        parts: that cannot be read, in their order.
        is_cut: whether data is missing at the end of the file.
        has_no_index: whether the data is whole and the index after it is cut off.
        lost: further missing messages, by the statistics of the file or for lack of a channel.
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
        """Record the time of a message."""
        self.first_ns = time_ns if self.first_ns is None else min(self.first_ns, time_ns)
        self.last_ns = time_ns if self.last_ns is None else max(self.last_ns, time_ns)

    def lose(self, offset: int, length: int, index: Mapping[int, ChunkIndex | Chunk]) -> None:
        """Record an unreadable part, which contains the chunks of *index* inside it."""
        known = [one for place, one in index.items() if offset <= place < offset + length]
        ends = (self.last_ns, *(part.end_ns for part in self.parts[-1:]))
        begin = max((time for time in ends if time is not None), default=None)
        if begin is None:
            begin = min((one.message_start_time for one in known), default=None)
            self.first_ns = begin if self.first_ns is None else self.first_ns
        unknown = begin if index else None
        end = max((one.message_end_time for one in known), default=unknown)
        self.parts.append(Damage(offset, length, begin, end))

    def describe(self) -> str:
        """Return the place and size of the damage in one line."""
        if self.is_cut and self.last_ns is None:
            return f"it has no end: no message in its {counted(self.size, 'byte')} can be read"
        words = [self._part(part) for part in self.parts[:_SHOWN]]
        if len(self.parts) > _SHOWN:
            words.append(f"{counted(len(self.parts) - _SHOWN, 'more part')} cannot be read")
        if self.is_cut:
            words.append(self._end())
        if self.lost:
            words.append(f"{counted(self.lost, 'message')} cannot be read")
        if self.has_no_index:
            words.append("its data is whole, and the index behind it is cut off")
        if len(self.parts) > 1:
            words.append(self._sum())
        return "; ".join(words)

    def _sum(self) -> str:
        missing = sum(part.count for part in self.parts)
        spans = [(p.begin_ns, p.end_ns) for p in self.parts]
        seconds = sum(end - begin for begin, end in spans if begin is not None and end is not None)
        least = "at least " if self.is_cut or any(None in span for span in spans) else ""
        time = f"{1e-9 * seconds:.3f} s, " if seconds else ""
        return f"missing in all: {least}{time}{counted(missing, 'byte')}"

    def _part(self, part: Damage) -> str:
        begin, end = self._seconds(part.begin_ns), self._seconds(part.end_ns)
        if part.begin_ns is None:
            place = "at its beginning"
        elif part.end_ns is None:
            place = f"from {begin} s on"
        else:
            place = f"from {begin} s to {end} s"
        return f"it cannot be read {place} ({counted(part.count, 'byte')} at byte {part.first})"

    def _end(self) -> str:
        whole = self.size - (self.parts[-1].count if self.parts else 0)
        return (
            f"it has no end: it reaches to {self._seconds(self.last_ns)} s, {whole} bytes, and "
            "what was recorded after that is not there"
        )

    def _seconds(self, time_ns: int | None) -> str:
        known = time_ns is not None and self.first_ns is not None
        return f"{1e-9 * (time_ns - self.first_ns):.3f}" if known else "?"  # type: ignore[operator]


def records(path: Path, damages: Damages) -> Iterator[McapRecord]:
    """Yield every record of an MCAP file that can be read, also those inside chunks.

    Args:
        path: of the file.
        damages: receives the parts that cannot be read.

    Raises:
        OSError: the file cannot be read.
        NotMcapError: it is no MCAP file.
        RecordingError: its chunks decompress to an absurd size.
    """
    check_regular(path)
    with path.open("rb") as stream:
        size = damages.size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        magic = stream.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            if magic and MCAP0_MAGIC.startswith(magic):
                raise RecordingError(f"{path}: an MCAP file cut off after {counted(size, 'byte')}")
            raise NotMcapError(f"{path}: not an MCAP file; expected a recording (.mcap)")
        summary = _summary(stream, size)
        # The end repeats the schemas and channels, which may be in a lost chunk.
        yield from (one for one in summary if isinstance(one, Schema | Channel))
        index = {one.chunk_start_offset: one for one in summary if isinstance(one, ChunkIndex)}
        begins = [one.message_start_time for one in index.values() if one.message_end_time]
        damages.first_ns = min(begins, default=None)
        record, count, room = None, 0, LARGEST_CHUNK + MOST_TIMES * size
        for record, offset, length in _top_level(stream, size, index):
            found: Iterator[McapRecord] | None = iter((record,)) if record is not None else None
            if isinstance(record, Chunk):
                grown = _grown(record)
                room -= grown
                if grown > LARGEST_CHUNK or room < 0:
                    raise RecordingError(f"{path}: a chunk becomes {grown / MEBIBYTE:.0f} MiB")
                found = _inside(record)
            chunk = {offset: record} if isinstance(record, Chunk) else {}
            if found is None:
                damages.lose(offset, length, index or chunk)
                continue
            try:
                for one in found:
                    if isinstance(one, Message):
                        damages.saw(one.log_time)
                        count += 1
                    yield one
            except (ValueError, LookupError, EOFError, McapError, struct.error):
                damages.lose(offset, length, index or chunk)
        is_whole = isinstance(record, DataEnd)
        has_end = _has_end(stream, size)
        damages.is_cut, damages.has_no_index = not (is_whole or has_end), is_whole and not has_end
        statistics = next((one for one in summary if isinstance(one, Statistics)), None)
        if statistics is not None and not damages:
            damages.lost = max(statistics.message_count - count, 0)


def _top_level(
    stream: IO[bytes], size: int, index: Mapping[int, ChunkIndex]
) -> Iterator[tuple[McapRecord | None, int, int]]:
    """Yield records outside of chunks with place and size up to the end of the data.

    ``None`` stands for a part that cannot be read.
    """
    offset, places = len(MCAP0_MAGIC), sorted(index)
    while offset < size:
        later = bisect(places, offset)
        following = places[later] if later < len(places) else size
        stream.seek(offset)
        head = stream.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, size)
        end = offset + _HEAD.size + length
        record = None
        if end <= following and (opcode == Opcode.CHUNK or offset not in index):
            if opcode in _IGNORED or opcode >= _PRIVATE:
                offset = end
                continue
            record = _record(opcode, stream.read(length))
        if record is None:
            end = following
        yield record, offset, end - offset
        if isinstance(record, DataEnd):
            return
        offset = end


def _has_end(stream: IO[bytes], size: int) -> bool:
    if size < len(MCAP0_MAGIC) + _FOOTER + len(MCAP0_MAGIC):
        return False
    stream.seek(size - len(MCAP0_MAGIC))
    return stream.read() == MCAP0_MAGIC


def _summary(stream: IO[bytes], size: int) -> list[McapRecord]:
    """Return the records after the data that can be read; none if they are cut off."""
    if not _has_end(stream, size):
        return []
    end = size - len(MCAP0_MAGIC) - _FOOTER
    stream.seek(end)
    footer = _record(Opcode.FOOTER, stream.read(_FOOTER)[_HEAD.size :])
    offset = footer.summary_start if isinstance(footer, Footer) else 0
    found: list[McapRecord] = []
    while len(MCAP0_MAGIC) < offset <= end - _HEAD.size:
        stream.seek(offset)
        opcode, length = _HEAD.unpack(stream.read(_HEAD.size))
        if offset + _HEAD.size + length > end:
            break
        record = _record(opcode, stream.read(length))
        if record is not None:
            found.append(record)
        offset += _HEAD.size + length
    return found


def _record(opcode: int, content: bytes) -> McapRecord | None:
    """Return a record, or ``None`` if it is damaged or not to be decoded."""
    try:
        if opcode == Opcode.MESSAGE:
            return _message(content)
        read = _READ.get(opcode)
        return None if read is None else read(ReadDataStream(BytesIO(content)))
    # The decoder does not document its exceptions for damaged bytes.
    except Exception:  # noqa: BLE001
        return None


def _message(content: bytes) -> Message:
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    return Message(
        channel_id=channel,
        sequence=sequence,
        log_time=log_time,
        publish_time=publish_time,
        data=content[_MESSAGE.size :],
    )


def _grown(chunk: Chunk) -> int:
    """Return the decompressed size of a chunk, by its own word and by its content."""
    said = chunk.uncompressed_size
    if chunk.compression == "zstd":
        try:
            return max(said, get_frame_parameters(chunk.data).content_size)
        except Exception:  # noqa: BLE001 - damaged, as the decompression reports
            return 0
    return max(said, len(chunk.data))


def _inside(chunk: Chunk) -> Iterator[McapRecord] | None:
    """Return the records of a chunk, which are made one by one; ``None`` if it is damaged."""
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        return _each(stream.read(size))
    except Exception:  # noqa: BLE001 - as in _record
        return None


def _each(content: bytes) -> Iterator[McapRecord]:
    offset = 0
    while offset < len(content):
        opcode, length = _HEAD.unpack_from(content, offset)
        begin = offset + _HEAD.size
        offset = begin + length
        if offset > len(content):
            raise EOFError
        if opcode == Opcode.MESSAGE:
            yield _message(content[begin:offset])
        elif opcode in (Opcode.CHANNEL, Opcode.SCHEMA):
            yield _READ[opcode](ReadDataStream(BytesIO(content[begin:offset])))
