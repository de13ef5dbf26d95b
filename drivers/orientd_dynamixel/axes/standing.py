"""What an axis does once a fault keeps it from following the path: it stands where it is.

A servo whose torque is on goes to its goal as soon as what holds it lets go.  So an axis that has
failed gets its own position as its goal at once, while the others are braked on the path; when they
are at rest, all of them are looked at again.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

from orientd.errors import LinkError
from orientd_dynamixel import settings
from orientd_dynamixel.axis import TICKS, Axis, sendable
from orientd_dynamixel.bus import Group, ServoBus

_KEPT_TICKS = round(0.5 / 360 * TICKS)
"""A goal this close to the position is kept: the load hangs on the difference."""
_FAR_TICKS = round(1.0 / 360 * TICKS)
"""Farther away than this, an axis does not merely lag behind its goal."""
_SETTLING_NS = 100_000_000
"""After this time at rest an axis no longer lags behind its goal."""
_RETRY_NS = 200_000_000
"""How often one axis is asked alone where the bus does not answer as a whole."""


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
        self._since_ns = self._asked_ns = 0

    def fail(self, place: int, position: int) -> bool:
        """Let the axis at *place* stand at *position*, in ticks; return whether that is new."""
        if place in self.goals:
            return False
        self.goals[place] = sendable(position)
        return True

    def rest(self, now_ns: int) -> None:
        """Let all axes stand, each where it is found to be from now on."""
        if not self.is_at_rest:
            self.is_at_rest = True
            self._since_ns = self._asked_ns = now_ns
            self._pending = [n for n in range(len(self._axes)) if n not in self.goals]

    def send(self, bus: ServoBus, group: Group, now_ns: int) -> None:
        """Send the goals of axes at rest, after slow profiles, should one move all the same.

        Raises:
            LinkError: the port is gone.
        """
        if group.time_ns > self._since_ns:
            for place in list(self._pending):
                self._settle(place, group.readings[place].position, group.time_ns)
        elif self._pending and now_ns - self._asked_ns > _RETRY_NS:
            # One that is silent hides the answers of the others.
            self._asked_ns = now_ns
            place = self._pending.pop(0)
            self._pending.append(place)
            group.settle(now_ns, 0.0)
            with contextlib.suppress(LinkError):
                servo = self._axes[place].options.id
                position = bus.read(servo, settings.POSITION, 4, is_signed=True)
                self._settle(place, position, now_ns)
        for place, goal in self.goals.items():
            self._axes[place].goal = goal
        ids = [axis.options.id for axis in self._axes]
        bus.sync_write(settings.PROFILE_VELOCITY, 4, [(one, settings.PARK_RATE) for one in ids])
        bus.sync_write(settings.GOAL, 4, [(axis.options.id, axis.goal) for axis in self._axes])

    def _settle(self, place: int, position: int, measured_ns: int) -> None:
        apart = abs(position - self._axes[place].goal)
        is_settled = measured_ns - self._since_ns > _SETTLING_NS
        if apart > (_KEPT_TICKS if is_settled else _FAR_TICKS):
            self.goals[place] = sendable(position)
            is_settled = True
        if is_settled:
            self._pending.remove(place)
