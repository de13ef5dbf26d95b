"""The newest cycles of a device, kept in memory as the servo has packed them.

The servo's cycles stay in shared memory for a few seconds only.  At intervals the device's thread
copies the new slots unchanged to a file in memory, in one or two calls.  The reader of that file
checks whether a slot holds a whole record.
"""

from __future__ import annotations

import os
import weakref

from orientd.stream.records import CYCLE_RECORD
from orientd.stream.ring import RecordRing

_STRIDE = RecordRing.stride(CYCLE_RECORD)
_BATCH = 64
"""Cycles that are new before any of them is copied."""

_MARGIN = 16
"""Slots that the servo may be about to write."""


class CycleMemory:
    """The newest cycles of one device, across restarts of its servo process.

    Attributes:
        end: bytes copied so far; the newest of them are kept.
    """

    def __init__(self, capacity: int) -> None:
        """Reserve room for *capacity* cycles; memory is used as they come."""
        self.end = 0
        self._size = capacity * _STRIDE
        self._file = os.memfd_create("orientd-cycles", os.MFD_CLOEXEC)
        weakref.finalize(self, os.close, self._file)
        self._ring: RecordRing | None = None
        self._next = 0

    def take(self, ring: RecordRing, *, is_last: bool = False) -> None:
        """Copy the new cycles of *ring*; call this from one thread, a few times a second.

        Args:
            ring: of cycles.
            is_last: whether to copy even a few.

        Raises:
            OSError: there is no memory for it.
        """
        head = ring.head
        if ring is not self._ring:
            self._ring, self._next = ring, 0
        if head == self._next or (head - self._next < _BATCH and not is_last):
            return
        first = max(self._next, head - ring.capacity + _MARGIN)
        for slots in ring.slots(first, head - first):
            while slots:
                at = self.end % self._size
                written = os.pwrite(self._file, slots[: self._size - at], at)
                slots = slots[written:]
                self.end += written
        self._next = head

    def copy_to(self, descriptor: int) -> None:
        """Write all cycles to a file, oldest first; new cycles meanwhile overwrite the oldest.

        Raises:
            OSError: the file's disk or memory is full.
        """
        sent, end = max(0, self.end - self._size), self.end
        while sent < end:
            at = sent % self._size
            sent += os.sendfile(descriptor, self._file, at, min(self._size - at, end - sent))
