"""Follow poses with limited axes: exactly if the axes can, otherwise as closely as possible.

For targets and for stops off the path, which have no planned path, on devices that take joints.
Plain floats only, since the servo runs it.
"""

from __future__ import annotations

from array import array
from math import ceil, copysign, floor, inf, sqrt, tau

from orientd import kernels
from orientd.driver import Joints, Quaternion, Vector3
from orientd.mechanism.chain import axis_rows
from orientd.mechanism.mechanism import Mechanism, Rows

_OUTSIDE = 1e3
"""Cost of a radian outside an axis' limits, in seconds of its travel."""
_FAR = 1e6
"""Largest angle, rad, of an axis without limits of its angle."""
_AWAY = 1e-3
"""Angle by which a tool that cannot reach a cone is farther away, rad."""
USABLE = 0.99
"""Usable share of the limits of an axis; the rest is for rounding and for the ticks of a servo."""


class Following:
    """Joint setpoints from cycle to cycle.

    Args:
        mechanism: kinematics and limits of the axes.
        period: cycle period, s.
        chain: the kinematics in numbers, see :func:`~orientd.mechanism.chain.chain_of`.
    """

    def __init__(
        self, mechanism: Mechanism, period: float, chain: array[float] | None = None
    ) -> None:
        self._mechanism = mechanism
        self._chain, self._limits = chain, axis_rows(mechanism, USABLE)
        self._axes = mechanism.axes
        self._period = period
        self._wanted: Joints = ()

    def begin(self) -> None:
        """Start over: the next poses do not continue the previous ones."""
        self._wanted = ()

    def step(self, q: Quaternion, position: Vector3, last: Joints, rates: Joints) -> Joints:
        """Return the joints of the next cycle towards a pose, rad.

        Args:
            q: tool orientation.
            position: tool position, m.
            last: joints of the previous cycle, rad, unwrapped.
            rates: axis velocities in that cycle, rad/s.
        """
        mechanism = self._mechanism
        wanted = self._chosen(q, position, last)
        if wanted is None:
            return self.braked(last, rates)
        outer = self._next(0, wanted[0], last[0], rates[0])
        # The other axes compensate for the lag of the outermost axis, as far as they can.
        others = mechanism.completed(q, position, outer, wanted)[1:]
        wanted = (wanted[0], *self._inside((outer, *others), last)[1:])
        inner = [
            self._next(place, wanted[place], last[place], rates[place])
            for place in range(1, len(wanted))
        ]
        self._wanted = wanted
        return (outer, *inner)

    def _chosen(self, q: Quaternion, position: Vector3, last: Joints) -> Joints | None:
        """Return the joints for a pose that take the least time; ``None`` if it is out of reach."""
        mechanism = self._mechanism
        near = mechanism.nearest(q, position, last)
        if near is not None and self._cost(near, last) < _OUTSIDE:
            return near
        every = [self._inside(one, last) for one in mechanism.solutions(q, position)]
        return min(every, key=lambda one: self._cost(one, last), default=near)

    def braked(self, last: Joints, rates: Joints) -> Joints:
        """Return the joints of the next cycle on the fastest stop, rad."""
        joints = []
        for axis, angle, rate in zip(self._axes, last, rates, strict=True):
            step = USABLE * axis.acceleration * self._period
            joints.append(angle + self._period * (rate - min(max(rate, -step), step)))
        self._wanted = ()
        return tuple(joints)

    def brakes_outside(self, joints: Joints, last: Joints, clearance: float, cones: Rows) -> bool:
        """Return whether the tool stays outside of cones if the axes go to *joints* and brake.

        Inside of a cone, the tool must not come nearer to its centre.

        Args:
            joints: of the next setpoint, rad.
            last: of the last setpoint, rad.
            clearance: angle from the tool's axis to the nearest cone at the last setpoint, rad.
            cones: see ``kernels/c/chain.h``.
        """
        h = self._period
        rates = [(a - b) / h for a, b in zip(joints, last, strict=True)]
        # Every axis turns the tool by at most its own angle.
        reach = 0.0
        for rate, axis in zip(rates, self._axes, strict=True):
            reach += abs(rate) * (h + 0.5 * abs(rate) / (USABLE * axis.acceleration))
        if clearance > reach + _AWAY:
            return True
        moving = Rows(2, len(rates), (*last, *rates))
        return self._chain is not None and kernels.brakes_outside(
            self._chain, self._limits.view, moving.view, h, cones.view
        )

    def _inside(self, joints: Joints, last: Joints) -> Joints:
        """Return *joints* on the turns nearest to *last*, within the limits if possible."""
        found = []
        for angle, near, axis in zip(joints, last, self._axes, strict=True):
            turns = round((near - angle) / tau)
            least = ceil((max(axis.low, near - _FAR) - angle) / tau)
            most = floor((min(axis.high, near + _FAR) - angle) / tau)
            if least <= most:
                turns = min(max(turns, least), most)
            found.append(angle + tau * turns)
        return tuple(found)

    def _cost(self, joints: Joints, last: Joints) -> float:
        """Return the shortest travel time of the axes, s, with a penalty outside their limits."""
        worst = outside = 0.0
        for angle, near, axis in zip(joints, last, self._axes, strict=True):
            worst = max(worst, abs(angle - near) / axis.velocity)
            outside += max(axis.low - angle, angle - axis.high, 0.0)
        return worst + _OUTSIDE * (1.0 + outside) * (outside > 0.0)

    def _next(self, place: int, wanted: float, last: float, rate: float) -> float:
        """Return the angle of the axis at *place* after one cycle towards *wanted*."""
        axis, period = self._axes[place], self._period
        wanted = min(max(wanted, axis.low), axis.high)
        before = self._wanted[place] if self._wanted else wanted
        before = min(max(before, axis.low), axis.high)
        hardest, fastest = USABLE * axis.acceleration, USABLE * axis.velocity
        # Relative to the moving target angle, so that the axis follows a steady motion without lag.
        gap = before - last
        pace = (wanted - before) / period
        if abs(pace) > fastest:
            pace, gap = 0.0, wanted - last
        aim = pace + copysign(_braking(abs(gap), hardest, period), gap)
        room = axis.high - last if aim > 0.0 else last - axis.low
        bound = min(fastest, _braking(min(max(room, 0.0), _FAR), hardest, period))
        aim = min(max(aim, -bound), bound)
        step = hardest * period
        return last + period * min(max(aim, rate - step), rate + step)


def _braking(distance: float, hardest: float, period: float) -> float:
    """Return the largest speed from which an axis can stop within *distance*, in whole cycles.

    In n cycles, each slower than the previous one by *hardest* times the period, the first may have
    a speed of distance / (n period) + hardest period (n - 1) / 2.
    """
    if hardest == inf:
        return distance / period
    step = hardest * period * period
    cycles = max(1, ceil((sqrt(1.0 + 8.0 * distance / step) - 1.0) / 2.0))
    return distance / (cycles * period) + 0.5 * hardest * period * (cycles - 1)
