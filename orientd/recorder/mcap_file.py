"""Read an MCAP file with the library's reader, and say how far that goes.

The reader stops at the first record that it cannot read.  That is the end of a file whose recorder
was killed or whose disk was full, or a damaged part.  ``mcap recover``, a command of MCAP, makes a
whole file of such a file and passes over damaged chunks.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedReader, BytesIO
from pathlib import Path

from lz4.frame import LZ4FrameDecompressor
from mcap.exceptions import EndOfFile
from mcap.records import Chunk, DataEnd, McapRecord, Message, Statistics
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC
from zstandard import ZstdDecompressor

from orientd.files import MEBIBYTE, check_regular
from orientd.one_line import counted
from orientd.recorder.writer import RecordingError

LARGEST_CHUNK = 64 * MEBIBYTE
"""Largest decompressed chunk; other programs write chunks of a few MiB, or of one image."""

MOST_TIMES = 100
"""Largest ratio of all decompressed chunks to the file, beyond the first :data:`LARGEST_CHUNK`."""


class NotMcapError(RecordingError):
    """A file of another kind."""


@dataclass(slots=True)
class Damages:
    """How far a recording can be read, if not to its end.

    Attributes:
        path: of the file.
        size: of the file, bytes.
        reached: bytes before the first record that cannot be read.
        is_short: whether there is such a record.
        is_cut: whether the end of the file is missing.
        has_data: whether all of the data was read, so that only the index behind it is missing.
        lost: messages that are missing by the count in the file, have no channel or do not decode.
        first_ns: time of the first message.
        last_ns: time of the last message that was read.
    """

    path: Path = Path()
    size: int = 0
    reached: int = 0
    is_short: bool = False
    is_cut: bool = False
    has_data: bool = False
    lost: int = 0
    first_ns: int | None = None
    last_ns: int | None = None

    def __bool__(self) -> bool:
        return self.is_short or self.lost > 0

    def saw(self, time_ns: int) -> None:
        """Record the time of a message."""
        self.first_ns = time_ns if self.first_ns is None else min(self.first_ns, time_ns)
        self.last_ns = time_ns if self.last_ns is None else max(self.last_ns, time_ns)

    def describe(self, *more: str) -> str:
        """Return the damage, *more* about it, and the cure in one line."""
        words = [self._extent()] if self.is_short else []
        if self.lost:
            words.append(f"{counted(self.lost, 'message')} cannot be read")
        words += more
        if self.is_short and not (self.is_cut and self.last_ns is None):
            is_broken = not self.is_cut and not self.has_data
            does = "passes over damaged chunks" if is_broken else "makes a whole file of it"
            words.append(f"`mcap recover {self.path} -o NEW.mcap` {does}")
        return "; ".join(words)

    def _extent(self) -> str:
        place = f"{self.reached} of {counted(self.size, 'byte')}"
        if self.has_data:
            return f"its data is whole, and the index behind it cannot be read ({place})"
        problem = "it has no end" if self.is_cut else "it is damaged"
        if self.first_ns is None or self.last_ns is None:
            return f"{problem}: no message in its {counted(self.size, 'byte')} can be read"
        seconds = 1e-9 * (self.last_ns - self.first_ns)
        return f"{problem}: it can be read to {seconds:.3f} s ({place})"


def records(path: Path, damages: Damages) -> Iterator[McapRecord]:
    """Yield the records of an MCAP file, also those inside chunks, up to the first damage.

    Args:
        path: of the file.
        damages: receives how far the file can be read.

    Raises:
        OSError: the file cannot be read.
        NotMcapError: it is no MCAP file.
        RecordingError: its chunks decompress to an absurd size.
    """
    check_regular(path)
    with path.open("rb") as stream:
        damages.path, damages.size = path, stream.seek(0, os.SEEK_END)
        stream.seek(0)
        _check_magic(path, stream.read(len(MCAP0_MAGIC)))
        stream.seek(0)
        found, count, expected = _each(stream, damages), 0, 0
        while True:
            try:
                record = next(found, None)
            except (OSError, RecordingError):
                raise
            # The library does not document its exceptions for damaged bytes.
            except Exception:  # noqa: BLE001
                damages.is_short, damages.is_cut = True, not _has_end(stream)
                return
            if record is None:
                break
            if isinstance(record, Message):
                damages.saw(record.log_time)
                count += 1
            elif isinstance(record, DataEnd):
                damages.has_data = True
            elif isinstance(record, Statistics):
                expected = record.message_count
            yield record
        damages.lost += max(expected - count, 0)
        damages.reached = stream.tell()
        if damages.reached < damages.size:
            damages.is_short, damages.is_cut, damages.has_data = True, not _has_end(stream), False


def _check_magic(path: Path, magic: bytes) -> None:
    if magic == MCAP0_MAGIC:
        return
    if magic and MCAP0_MAGIC.startswith(magic):
        raise RecordingError(f"{path}: an MCAP file cut off after {counted(len(magic), 'byte')}")
    raise NotMcapError(f"{path}: not an MCAP file; expected a recording (.mcap)")


def _has_end(stream: BufferedReader) -> bool:
    """Return whether a file that begins as an MCAP file also ends as one."""
    is_longer = stream.seek(-len(MCAP0_MAGIC), os.SEEK_END) > 0
    return is_longer and stream.read() == MCAP0_MAGIC


def _each(stream: BufferedReader, damages: Damages) -> Iterator[McapRecord]:
    """Yield the records of a file, and note where each of them ends.

    Raises:
        Exception: a record is damaged, or cut off.
        RecordingError: the chunks decompress to an absurd size.
    """
    room = LARGEST_CHUNK + MOST_TIMES * damages.size
    reader = StreamReader(
        stream, emit_chunks=True, validate_crcs=True, record_size_limit=damages.size
    )
    for record in reader.records:
        if isinstance(record, Chunk):
            size = record.uncompressed_size
            room -= size
            if size > LARGEST_CHUNK or room < 0:
                raise RecordingError(f"{damages.path}: a chunk becomes {size / MEBIBYTE:.0f} MiB")
            yield from _inside(record)
        else:
            yield record
        damages.reached = stream.tell()
        # A lost write leaves zeros, which the reader takes for millions of empty records.
        if stream.peek(1)[:1] == b"\0":
            raise ValueError("no record begins with a zero")


def _inside(chunk: Chunk) -> Iterator[McapRecord]:
    """Yield the records of a chunk, which are made one by one."""
    plain = dataclasses.replace(chunk, compression="", data=_decompressed(chunk))
    content, size = get_chunk_data_stream(plain, validate_crc=True)
    # The reader waits for a footer, which a chunk does not have.
    with contextlib.suppress(EndOfFile):
        yield from StreamReader(BytesIO(content.read(size)), skip_magic=True).records


def _decompressed(chunk: Chunk) -> bytes:
    """Return the content of a chunk, without decompressing more than the chunk declares.

    Raises:
        ValueError: it has another size.
    """
    content, most = chunk.data, chunk.uncompressed_size + 1
    if chunk.compression == "zstd":
        content = ZstdDecompressor().stream_reader(chunk.data).read(most)
    elif chunk.compression == "lz4":
        content = LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"expected {chunk.uncompressed_size} bytes, got {len(content)} or more")
    return content
