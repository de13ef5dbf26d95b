"""A path of orientations as the axes of a gimbal make it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.rotation import Floats


class Slew(NamedTuple):
    """A section of a path in which all axes of a gimbal turn evenly.

    Near a pole its orientations do not tell how the axes share the turn.

    Attributes:
        begin: path time, s.
        end: path time, s.
        here: axis angles at its beginning, rad.
        there: axis angles at its end, rad.
        aside: how far the second axis turns aside on the way, rad.
        q: orientation of the path, if the path rests meanwhile.
    """

    begin: float
    end: float
    here: Joints
    there: Joints
    aside: float = 0.0
    q: Floats | None = None

    def angles(self, shares: Floats) -> Floats:
        """Return the axis angles at shares of the way, from 0 to 1, rad, shape ``(n, axes)``."""
        gap = np.subtract(self.there, self.here)
        found: Floats = np.array(self.here) + shares[:, None] * gap
        found[:, 1] += 4.0 * self.aside * shares * (1.0 - shares)
        return found

    def moved(self, clock: Callable[[Floats], Floats]) -> Slew:
        """Return the same slew at other path times."""
        begin, end = clock(np.array([self.begin, self.end])).tolist()
        return self._replace(begin=begin, end=end)


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A path of orientations as the axes of a gimbal make it.

    Attributes:
        trajectory: from path time 0 on.
        times: of the keyframes, s.
        notes: what differs from the requested path, one line each.
        missed: largest angle by which it deviates from that path outside of slews, rad.
        slews: in order.
    """

    trajectory: Trajectory
    times: Floats
    notes: tuple[str, ...] = ()
    missed: float = 0.0
    slews: tuple[Slew, ...] = ()

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.trajectory.duration
