"""What an axis does once a fault keeps it from following the path: it stands where it is.

A servo whose torque is on goes to its goal as soon as what holds it lets go.  So an axis that has
failed gets its own position as its goal at once, while the others are braked on the path; when they
are at rest, all of them are looked at again.  Only positions that are believed become goals: an
axis of which nothing is believed keeps the goal that it has.
"""

from __future__ import annotations

from collections.abc import Sequence

from orientd_dynamixel import settings
from orientd_dynamixel.axis import TICKS, Axis, sendable
from orientd_dynamixel.bus import ServoBus
from orientd_dynamixel.whereabouts import GOAL

_KEPT_TICKS = round(0.5 / 360 * TICKS)
"""A goal this close to the position is kept: the load hangs on the difference."""
_FAR_TICKS = round(1.0 / 360 * TICKS)
"""Farther away than this, an axis does not merely lag behind its goal."""
_SETTLING_NS = 100_000_000
"""After this time at rest an axis no longer lags behind its goal."""
_ALONE_NS = 200_000_000
"""After this time without an answer from all, one is asked alone every other time."""


class Standing:
    """The axes that stand, and their goals.

    Attributes:
        goals: ticks, by the axis' place.
        is_at_rest: whether no axis follows the path any more.
    """

    def __init__(self, axes: Sequence[Axis]) -> None:
        self.goals: dict[int, int] = {}
        self.is_at_rest = False
        self._axes = axes
        self._pending: list[int] = []
        self._since_ns = 0
        self._is_alone = False

    def fail(self, place: int) -> bool:
        """Let the axis at *place* stand where it was last seen; return whether that is new."""
        if place in self.goals:
            return False
        axis = self._axes[place]
        self.goals[place] = axis.goal if axis.position is None else sendable(axis.position)
        return True

    def rest(self, now_ns: int) -> None:
        """Let all axes stand, each where it is found to be from now on; again if asked again."""
        looked_at = range(len(self._axes))
        self._pending = [n for n in looked_at if self.is_at_rest or n not in self.goals]
        self.is_at_rest, self._since_ns = True, now_ns

    def stands(self, place: int, now_ns: int) -> bool:
        """Return whether the axis at *place* stands by now, and does not merely lag behind."""
        return place in self.goals or (self.is_at_rest and now_ns - self._since_ns > _SETTLING_NS)

    def alone(self, now_ns: int) -> int | None:
        """Return the place of the axis to ask alone now; ``None`` to ask all of them.

        One that is silent hides the answers of the others.
        """
        self._is_alone = not self._is_alone
        if not (self._pending and self._is_alone and now_ns - self._since_ns > _ALONE_NS):
            return None
        place = self._pending.pop(0)
        self._pending.append(place)
        return place

    def send(self, bus: ServoBus) -> None:
        """Send the goals of axes at rest, after slow profiles, should one move all the same.

        Raises:
            LinkError: the port is gone.
        """
        for place in list(self._pending):
            self._settle(place)
        for place, goal in self.goals.items():
            self._axes[place].goal = goal
        ids = [axis.options.id for axis in self._axes]
        bus.sync_write(settings.PROFILE_VELOCITY, 4, [(one, settings.PARK_RATE) for one in ids])
        bus.sync_write(GOAL, 4, [(axis.options.id, axis.goal) for axis in self._axes])

    def _settle(self, place: int) -> None:
        axis = self._axes[place]
        if axis.position is None or axis.seen_ns <= self._since_ns:
            return
        is_settled = axis.seen_ns - self._since_ns > _SETTLING_NS
        if abs(axis.position - axis.goal) > (_KEPT_TICKS if is_settled else _FAR_TICKS):
            self.goals[place] = sendable(axis.position)
            is_settled = True
        if is_settled:
            self._pending.remove(place)
