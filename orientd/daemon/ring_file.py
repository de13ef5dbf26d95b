"""The newest of what is written, in a file in memory: none of it is memory of the daemon."""

from __future__ import annotations

import os
import weakref
from collections.abc import Iterator


class RingFile:
    """Bytes one after another, each at a place that it keeps until newer ones need the room.

    Attributes:
        size: how many bytes there is room for.
        end: place of what will be written next; the first byte of all was at 0.
    """

    def __init__(self, name: str, size: int) -> None:
        """Reserve room for *size* bytes; memory is used as they come.

        Args:
            name: of the file, for whoever looks at the process.
            size: of the room.
        """
        self.size, self.end = size, 0
        self._file = os.memfd_create(name, os.MFD_CLOEXEC)
        weakref.finalize(self, os.close, self._file)

    def restart(self, size: int) -> None:
        """Forget all that is there, and have room for *size* bytes from now on."""
        self.size, self.end = size, 0

    def append(self, content: bytes | memoryview) -> None:
        """Write *content* where the oldest bytes are, or the end of it if there is too much.

        Raises:
            OSError: there is no memory for it.
        """
        content = memoryview(content)[-self.size :]
        for at, count in self._parts(self.end, len(content)):
            os.pwrite(self._file, content[:count], at)
            content = content[count:]
            self.end += count

    def read(self, place: int, count: int) -> bytes:
        """Return *count* bytes from a *place* on that is still there."""
        return b"".join(os.pread(self._file, n, at) for at, n in self._parts(place, count))

    def copy_to(self, descriptor: int) -> None:
        """Write all that is there to a file, oldest first; it goes on changing, the oldest first.

        Raises:
            OSError: there is no room for it.
        """
        kept = min(self.end, self.size)
        for at, count in self._parts(self.end - kept, kept):
            end = at + count
            while at < end and (sent := os.sendfile(descriptor, self._file, at, end - at)):
                at += sent

    def _parts(self, place: int, count: int) -> Iterator[tuple[int, int]]:
        """Yield where in the file the bytes from a place on are, and how many."""
        at = place % self.size
        first = min(count, self.size - at)
        yield at, first
        if count > first:
            yield 0, count - first
