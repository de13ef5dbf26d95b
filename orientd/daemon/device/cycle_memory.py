"""The newest cycles of a device, kept in memory as the servo has packed them.

What the servo publishes stays in shared memory for a few seconds only.  Every now and then the
device's thread copies what is new there, slot by slot as it is, to a file in memory, which is one
or two calls; whether a slot holds a whole record is for its reader to check.
"""

from __future__ import annotations

from orientd.daemon.ring_file import RingFile
from orientd.stream import CYCLE_RECORD, RecordRing

_STRIDE = RecordRing.stride(CYCLE_RECORD)
_BATCH = 64
"""Cycles that are new before any of them is copied."""

_MARGIN = 16
"""Slots that the servo may be about to write."""


class CycleMemory(RingFile):
    """The newest cycles of one device, across restarts of its servo process."""

    def __init__(self, capacity: int) -> None:
        """Reserve room for *capacity* cycles; memory is used as they come."""
        super().__init__("orientd-cycles", capacity * _STRIDE)
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
            self.append(piece)
        self._next = head
