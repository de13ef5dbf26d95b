"""Where on the path the servo is, and how much path there still is.

Path time is counted in records: ``index + fraction``.  A motion as planned moves by exactly one
record a cycle, so its setpoints *are* the records; between two records a
:class:`~orientd.servo.segment.Segment` is evaluated.
"""

from __future__ import annotations

from orientd.driver import IDENTITY, ZERO
from orientd.errors import OrientdError
from orientd.servo.segment import PathPoint, Segment, point_of
from orientd.stream import RecordRing

FINAL_WORD = 1
"""Word of the path ring: one more than the index of the motion's last record; 0 until written."""

TAIL_WORD = 2
"""Word of the path ring: index of the oldest record that the servo still needs."""

_ATTEMPTS = 3


class StarvedError(OrientdError):
    """The next record is not in the ring."""


class PathFollower:
    """A position on the path ring.

    Attributes:
        index: the record at or before the setpoint.
        fraction: how far beyond it, in records, in [0, 1).
    """

    def __init__(self, ring: RecordRing, period: float) -> None:
        """Follow *ring*, whose records are *period* seconds of path time apart."""
        self.index = 0
        self.fraction = 0.0
        self._ring = ring
        self._period = period
        self._point = PathPoint(IDENTITY, ZERO, ZERO, ZERO, ZERO)
        self._segment: Segment | None = None

    def peek(self, index: int) -> PathPoint | None:
        """Return record *index*, or ``None`` where it is not in the ring."""
        if index >= self._ring.head:
            return None
        for _ in range(_ATTEMPTS):  # a record being published is there a microsecond later
            fields = self._ring.read(index)
            if fields is not None:
                return point_of(fields)
        return None

    def begin(self, index: int) -> None:
        """Stand on record *index*, which is in the ring."""
        self.index, self.fraction = index, 0.0
        self._load(index)
        self._ring.set_word(TAIL_WORD, index)

    @property
    def is_at_end(self) -> bool:
        """Whether this is the motion's last record."""
        return self.index + 1 == self._ring.word(FINAL_WORD)

    def reaches(self, records: int) -> bool:
        """Whether the motion's end, or at least so many records beyond here, are in the ring."""
        head = self._ring.head
        return head == self._ring.word(FINAL_WORD) or head - 1 - self.index >= records

    def advance(self, records: float) -> PathPoint:
        """Move on by that many records, in [0, 1], and return the point there.

        The last record of a motion is never passed.

        Raises:
            StarvedError: the path ends here without being at rest; the position is unchanged.
        """
        final = self._ring.word(FINAL_WORD) - 1
        place = self.fraction + records
        index, fraction = self.index, place
        if place >= 1.0:
            index, fraction = self.index + 1, place - 1.0
        if final >= 0 and index >= final:
            index, fraction = final, 0.0
        if index != self.index:
            self._load(index)
        if fraction == 0.0:
            point = self._point
        else:
            if self._segment is None:
                end = self.peek(index + 1)
                if end is None:
                    raise StarvedError(f"path record {index + 1} is not in the ring")
                self._segment = Segment(self._point, end, self._period)
            point = self._segment.at(fraction)
        self.index, self.fraction = index, fraction
        self._ring.set_word(TAIL_WORD, index)
        return point

    def _load(self, index: int) -> None:
        point = self.peek(index)
        if point is None:
            raise StarvedError(f"path record {index} is not in the ring")
        self._point = point
        self._segment = None
