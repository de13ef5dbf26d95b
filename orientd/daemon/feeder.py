"""The feeder: samples a motion, block by block, into the path ring.

It keeps the ring full ahead of the servo, and holds no more of a motion than the ring does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orientd.planner import Motion
from orientd.servo.path_follower import FINAL_WORD, TAIL_WORD
from orientd.stream import PathFlag, RecordRing
from orientd.stream.records import PATH_FLOATS, PATH_RECORD

BLOCK = 512
"""Records sampled at a time."""

_MARGIN = 8
_LAYOUT = np.dtype(
    [
        ("index", "u8"),
        ("path_time_ns", "i8"),
        ("flags", "u4"),
        ("motion", "u4"),
        ("floats", "f8", (PATH_FLOATS,)),
    ],
    align=True,
)


class Feeder:
    """One motion on its way into the path ring.

    Attributes:
        motion: what is fed.
        number: of the motion.
        first_index: the ring's index of the motion's first record.
    """

    def __init__(self, ring: RecordRing, motion: Motion, number: int) -> None:
        """Begin behind whatever the ring holds; the servo stands still meanwhile."""
        self.motion = motion
        self.first_index = ring.head
        self._ring = ring
        self.number = number
        self._fed = 0
        ring.set_word(FINAL_WORD, 0)
        ring.set_word(TAIL_WORD, self.first_index)

    @property
    def final_index(self) -> int:
        """The ring's index of the motion's last record."""
        return self.first_index + self.motion.record_count - 1

    @property
    def is_done(self) -> bool:
        """Whether all of the motion is in the ring, or has been."""
        return self._fed == self.motion.record_count

    def feed(self, most: int) -> int:
        """Put up to *most* records more into the ring, as far as it has room; return how many."""
        ring = self._ring
        room = ring.word(TAIL_WORD) + ring.capacity - _MARGIN - ring.head
        count = min(most, room, self.motion.record_count - self._fed)
        if count <= 0:
            return 0
        block = self._records(self._fed, count)
        size = PATH_RECORD.size
        content = block.tobytes()
        head = ring.head
        for k in range(count):
            ring.put(content[k * size : (k + 1) * size], head + k)
        self._fed += count
        if self.is_done:
            ring.set_word(FINAL_WORD, head + count)
        ring.advance(head + count)
        return count

    def _records(self, first: int, count: int) -> NDArray[np.void]:
        motion = self.motion
        block = np.zeros(count, dtype=_LAYOUT)
        block["index"] = np.arange(self._ring.head, self._ring.head + count)
        block["path_time_ns"] = np.rint(np.arange(first, first + count) * motion.period * 1e9)
        block["motion"] = self.number
        if first + count == motion.record_count:
            block["flags"][-1] = PathFlag.LAST
        block["floats"] = motion.records(first, count)
        return block
