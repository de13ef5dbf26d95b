"""The feeder: copies the records of a motion, block by block, into the path ring.

It keeps the ring filled ahead of the servo, and holds no more of a motion than the ring does.
Behind the last record come some at rest: there a motion may follow that begins at rest.
"""

from __future__ import annotations

import struct

from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.planner.facts import MOTION_RECORD
from orientd.stream.records import FINAL_WORD, PATH_FLOATS, TAIL_WORD
from orientd.stream.ring import RecordRing

BLOCK = 512
"""Records copied at a time."""

MARGIN = 8
_index = struct.Struct("@Q").pack
_PATH_BYTES = 8 * PATH_FLOATS


class Feeder:
    """One motion on its way into the path ring.

    Attributes:
        motion: the motion to feed.
        first_index: the ring's index of the motion's first record.
    """

    def __init__(self, ring: RecordRing, motion: PlannedMotion, *, read_ahead: int) -> None:
        """Begin behind whatever the ring holds.

        Args:
            ring: of path records.
            motion: to feed.
            read_ahead: how many records the ring may hold beyond the servo's; the rest of it is
                kept for a motion that replaces this one.
        """
        self.motion = motion
        self.first_index = ring.head
        self._ring = ring
        self._fed = 0
        self._until = motion.rest_record + 1
        self._read_ahead = read_ahead
        self._is_running = False

    def clear(self) -> None:
        """Tell a servo at rest to ignore all records before this motion."""
        self._ring.words[FINAL_WORD] = 0
        self._ring.words[TAIL_WORD] = self.first_index

    def leave_at(self, record: int) -> None:
        """Feed nothing beyond *record* of the motion.

        Records beyond it that are in the ring already stay there, unused.
        """
        self._until = max(self._fed, record + 1)

    @property
    def is_whole(self) -> bool:
        """Whether the motion's last record is in the ring, or has been."""
        return self._fed >= self.motion.facts.record_count

    @property
    def is_done(self) -> bool:
        """Whether all records have been fed."""
        return self._fed >= self._until

    def has(self, record: int) -> bool:
        """Whether the motion is in the ring up to *record*, or has been."""
        return self._fed > record

    def feed(self, most: int, *, is_urgent: bool = False) -> int:
        """Add up to *most* records to the ring while it has space; return how many.

        Args:
            most: largest number of records.
            is_urgent: whether to use the reserved space too.
        """
        ring = self._ring
        size = ring.capacity - MARGIN if is_urgent else self._read_ahead
        room = ring.words[TAIL_WORD] + size - ring.head
        count = min(most, room, self._until - self._fed)
        if count <= 0:
            return 0
        head, records = ring.head, self.motion.feed(self._fed, count)
        places = range(0, len(records), MOTION_RECORD.size)
        ring.put(
            [
                _index(index) + records[at : at + _PATH_BYTES]
                for index, at in enumerate(places, start=head)
            ],
            head,
        )
        self._fed += len(places)
        if self._is_running:
            self._declare_end()
        ring.advance(head + len(places))
        return len(places)

    def begin(self) -> None:
        """Note that the servo runs the motion; from now on declare its end to the servo."""
        self._is_running = True
        self._declare_end()

    def _declare_end(self) -> None:
        if self.is_whole:
            self._ring.words[FINAL_WORD] = self.first_index + self.motion.facts.record_count
