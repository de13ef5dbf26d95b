"""The newest cycles of a device, kept in memory as the servo has packed them.

What the servo publishes stays in shared memory for a few seconds only.  Every now and then the
device's thread copies what is new there, slot by slot as it is, to a file in memory, which is one
or two calls; whether a slot holds a whole record is for its reader to check.
"""

from __future__ import annotations

import os

from orientd.stream import CYCLE_RECORD, RecordRing

_STRIDE = RecordRing.stride(CYCLE_RECORD)
_BATCH = 64
"""Cycles that are new before any of them is copied."""

_MARGIN = 16
"""Slots that the servo may be about to write."""


class CycleMemory:
    """The newest cycles of one device, across restarts of its servo process."""

    def __init__(self, capacity: int) -> None:
        """Reserve room for *capacity* cycles; memory is used as they come."""
        self._size = capacity * _STRIDE
        self._file = os.memfd_create("orientd-cycles", os.MFD_CLOEXEC)
        self._written = 0
        self._ring: RecordRing | None = None
        self._next = 0

    def take(self, ring: RecordRing, *, is_last: bool = False) -> None:
        """Copy what is new in *ring*; to be called by one thread, a few times a second.

        Args:
            ring: of cycles.
            is_last: whether to copy even a few.
        """
        head = ring.head
        if ring is not self._ring:
            self._ring, self._next = ring, 0
        if head == self._next or (head - self._next < _BATCH and not is_last):
            return
        first = max(self._next, head - ring.capacity + _MARGIN)
        for piece in ring.slots(first, head - first):
            self._append(piece)
        self._next = head

    @property
    def is_empty(self) -> bool:
        """Whether the device has run no cycle yet."""
        return not self._written

    def _append(self, piece: memoryview) -> None:
        piece = piece[-self._size :]
        at = self._written % self._size
        rest = self._size - at
        os.pwrite(self._file, piece[:rest], at)
        if len(piece) > rest:
            os.pwrite(self._file, piece[rest:], 0)
        self._written += len(piece)

    def close(self) -> None:
        """Give the memory back; nothing is copied any more."""
        os.close(self._file)

    def copy_to(self, descriptor: int) -> None:
        """Write the slots to a file, oldest first; they go on changing, the oldest first.

        Raises:
            OSError: there is no room for them.
        """
        kept = min(self._written, self._size)
        oldest = (self._written - kept) % self._size
        for begin, end in ((oldest, min(oldest + kept, self._size)), (0, oldest)):
            while begin < end:
                sent = os.sendfile(descriptor, self._file, begin, end - begin)
                if not sent:
                    break
                begin += sent
