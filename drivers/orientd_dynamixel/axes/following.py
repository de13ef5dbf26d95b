"""Follow targets with axes that have limits: exactly where they can, else as near as they can."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import Joints, Quaternion
from orientd.mechanism import Gimbal

_TURN = 2 * math.pi
_OUTSIDE = 1e3
"""Cost of a radian outside an axis' limits, against seconds of its travel."""
_MARGIN = 0.99
"""Share of its limits that an axis makes use of, so that rounding to ticks stays inside."""


class Following:
    """What the axes do from cycle to cycle.

    Args:
        gimbal: whose axes.
        period: of the cycles, s.

    Attributes:
        angles: axis angles last commanded, rad, unwrapped.
        rates: at which the axes turned there, rad/s.
    """

    def __init__(self, gimbal: Gimbal, period: float) -> None:
        self._gimbal = gimbal
        self._axes = gimbal.axes
        self._period = period
        self._wanted: Joints = ()
        self.angles: Joints = (0.0,) * len(gimbal.axes)
        self.rates: Joints = self.angles

    def step(self, q: Quaternion) -> tuple[float, ...]:
        """Return the axis angles for the next cycle on the way to *q*, rad."""
        angles, wanted = self.reach(q)
        self.took(angles, wanted)
        return angles

    def reach(self, q: Quaternion) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the axis angles for the next cycle on the way to *q*, and those that make it."""
        last = self.angles
        branches = self._gimbal.branches(q, last)
        branch = min((self._inside(one, last) for one in branches), key=self._cost)
        outer = self._next(0, branch[0])
        # What lags outside is made up for inside, as far as two angles can for three.
        kinematics = self._gimbal.kinematics
        others, _ = kinematics.inner(kinematics.matrix(q), outer)
        inner = self._inside((outer, *others), last)[1:]
        wanted = (branch[0], *inner)
        return (outer, *(self._next(k, angle) for k, angle in enumerate(inner, 1))), wanted

    def brake(self) -> tuple[float, ...]:
        """Return the axis angles for the next cycle on the quickest way to rest, rad."""
        angles = []
        for axis, last, rate in zip(self._axes, self.angles, self.rates, strict=True):
            step = _MARGIN * axis.acceleration * self._period
            angles.append(last + self._period * (rate - min(max(rate, -step), step)))
        self.took(angles)
        return tuple(angles)

    def took(self, angles: Sequence[float], wanted: Sequence[float] = ()) -> None:
        """Note the angles that are about to be commanded, and those wanted, if others."""
        steps = zip(angles, self.angles, strict=True)
        self.rates = tuple((a - b) / self._period for a, b in steps)
        self.angles, self._wanted = tuple(angles), tuple(wanted or angles)

    def rest(self, angles: Joints) -> None:
        """Begin anew, from rest at *angles*."""
        self.angles, self._wanted = angles, ()
        self.rates = (0.0,) * len(angles)

    def _inside(self, angles: Sequence[float], last: Sequence[float]) -> tuple[float, ...]:
        """Return *angles* on the turns nearest to *last* that are inside the limits, if any are."""
        found = []
        for angle, near, axis in zip(angles, last, self._axes, strict=True):
            least = math.ceil((axis.low - angle) / _TURN)
            most = math.floor((axis.high - angle) / _TURN)
            turns = round((near - angle) / _TURN)
            if least <= most:
                turns = min(max(turns, least), most)
            found.append(angle + _TURN * turns)
        return tuple(found)

    def _cost(self, angles: Sequence[float]) -> float:
        worst = outside = 0.0
        for angle, near, axis in zip(angles, self.angles, self._axes, strict=True):
            worst = max(worst, abs(angle - near) / axis.velocity)
            outside += max(axis.low - angle, angle - axis.high, 0.0)
        return worst + _OUTSIDE * outside

    def _next(self, place: int, wanted: float) -> float:
        """Return where the axis at *place* gets to in a cycle on its way to *wanted*."""
        axis, period = self._axes[place], self._period
        last, rate = self.angles[place], self.rates[place]
        wanted = min(max(wanted, axis.low), axis.high)
        before = self._wanted[place] if self._wanted else wanted
        before = min(max(before, axis.low), axis.high)
        hardest, fastest = _MARGIN * axis.acceleration, _MARGIN * axis.velocity
        # Beside the wanted angle as it moves, so that a steady one is followed without lag.
        gap = before - last
        pace = (wanted - before) / period
        if abs(pace) > fastest:
            pace, gap = 0.0, wanted - last
        aim = pace + math.copysign(_braking(abs(gap), hardest, period), gap)
        room = axis.high - last if aim > 0.0 else last - axis.low
        bound = min(fastest, _braking(max(room, 0.0), hardest, period))
        aim = min(max(aim, -bound), bound)
        step = hardest * period
        return last + period * min(max(aim, rate - step), rate + step)


def _braking(distance: float, hardest: float, period: float) -> float:
    """Return the largest speed from which rest is reached at *distance*, in whole cycles.

    Of n cycles, each slower than the one before by *hardest* times the period, the first may have
    a speed of distance / (n period) + hardest period (n - 1) / 2.
    """
    step = hardest * period * period
    cycles = max(1, math.ceil((math.sqrt(1.0 + 8.0 * distance / step) - 1.0) / 2.0))
    return distance / (cycles * period) + 0.5 * hardest * period * (cycles - 1)
