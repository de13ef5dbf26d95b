"""Corners between motions that are blended: whether and how near the device has passed them.

A motion that is blended with the next is left before its end.  It has passed its end where the next
one is nearest to that; until then a stop, a fault or a motion that replaces the next one keeps the
device from it, and what is said of the motion is that.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from orientd.daemon.devices import EventKind
from orientd.daemon.motions.motion_queue import QueuedMotion
from orientd.stream import Cycle

Tell = Callable[[EventKind, int, str], None]


class Corners:
    """The motions that have been left for the next one and have not passed their ends yet."""

    def __init__(self, tell: Tell) -> None:
        """Wait for none.

        Args:
            tell: is told how each of them has ended.
        """
        self._tell = tell
        self._waiting: list[tuple[QueuedMotion, QueuedMotion]] = []

    def look(self, left: list[QueuedMotion], first: QueuedMotion, cycle: Cycle) -> None:
        """Tell of the motions whose ends the device has passed, or will not pass any more.

        Args:
            left: those that the device has gone over from since the last look, in order.
            first: the motion that it has gone over to.
            cycle: where it is.
        """
        for queued, following in pairwise([*left, first]):
            self._leave(queued, following)
        waiting, self._waiting = self._waiting, []
        for queued, following in waiting:
            self._look_at(queued, following, cycle)

    def _leave(self, queued: QueuedMotion, following: QueuedMotion) -> None:
        if queued.is_replaced:
            self._tell(EventKind.MOTION_REPLACED, queued.number, "")
        elif following.motion.facts.corner is None:
            self._tell(EventKind.MOTION_DONE, queued.number, "")
        else:
            self._waiting.append((queued, following))

    def _look_at(self, queued: QueuedMotion, following: QueuedMotion, cycle: Cycle) -> None:
        facts = following.motion.facts
        time, distance = facts.corner or (0.0, 0.0)
        is_left = cycle.motion != following.number
        first = 0 if following.feeder is None else following.feeder.first_index
        record = following.last_record if is_left else cycle.path_index - first
        if record * facts.period >= time:
            text = f"{math.degrees(distance):.3g} deg from its end"
            self._tell(EventKind.MOTION_PASSED, queued.number, text)
        elif is_left:
            text = f"after it was left for motion {following.number}, before its end"
            self._tell(EventKind.MOTION_REPLACED, queued.number, text)
        else:
            self._waiting.append((queued, following))

    def end(self, text: str, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Tell of the others that the device has come to rest before it passed their ends.

        Args:
            text: why, where that is known here.
            kind: how they have ended.
        """
        waiting, self._waiting = self._waiting, []
        for queued, following in waiting:
            left = f"stopped after it was left for motion {following.number}, before its end"
            self._tell(kind, queued.number, f"{left}: {text}" if text else left)
