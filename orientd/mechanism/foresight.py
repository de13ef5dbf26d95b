"""Predict what followed targets demand of a mechanism's axes, from cycle to cycle.

Followed targets have no plan.  So the servo predicts the axes for each setpoint, and for the stop
that could follow it.  Kernels compute the poses and check the axes (``kernels/c/foresight.h``).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import NamedTuple

from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.mechanism.mechanism import Mechanism, Reserve, Rows

Pose = tuple[Quaternion, Vector3]

_MOST = 14
"""Most checked poses: the next setpoint, the first cycle of a stop, and one more for every cycle of
a short stop."""

_STRAINS = (
    "{0} would turn at {1:.3g} rad/s, the limit is {2:.3g}",
    "the speed of {0} would change by {1:.3g} rad/s^2, the limit is {2:.3g}",
    "{0} is at the end of its range, {1:.4g} rad",
)
"""Messages about an axis, in the order of ``kernels/c/foresight.h``."""


class AxisStop(NamedTuple):
    """A stop about one axis: its acceleration falls to a peak, stays there, and rises to zero.

    Attributes:
        axis: of the turn.
        speed: about it at the beginning, rad/s.
        rate: change of that speed, rad/s^2.
        phases: durations of the three parts, s.
        jerk: rad/s^3.
    """

    axis: Vector3
    speed: float
    rate: float
    phases: Vector3
    jerk: float


class ComingStop(NamedTuple):
    """The next setpoint, and a stop from it.

    Attributes:
        q: orientation ``(w, x, y, z)`` of the setpoint, tool to world.
        position: of the tool in the world, m.
        velocity: of the step to it, m/s.
        acceleration: of the stop of the position, m/s^2.
        braked: orientation after the first cycle of the stop.
        turning: the turn after that; ``None`` if there is none.
    """

    q: Quaternion
    position: Vector3
    velocity: Vector3
    acceleration: float
    braked: Quaternion
    turning: AxisStop | None

    def numbers(self, period: float) -> array[float]:
        """Return the numbers of ``coming_stop_t`` for cycles of *period* seconds."""
        axis, speed, rate, phases, jerk = self.turning or _NO_TURN
        pose = *self.q, *self.position, *self.velocity, self.acceleration, *self.braked
        return array("d", (period, *pose, *axis, speed, rate, *phases, jerk))


_NO_TURN = AxisStop(ZERO, 0.0, 0.0, ZERO, 0.0)


class Foresight:
    """The axes at the last setpoint and at the next ones.

    Args:
        mechanism: kinematics and limits of the axes.
        period: cycle period, s.
    """

    def __init__(self, mechanism: Mechanism, period: float) -> None:
        # Only here: the daemon imports this module too, and it does no mathematics.
        from orientd import kernels

        self._kernels = kernels
        self._mechanism = mechanism
        self._period = period
        self._sent: Pose | None = None
        self._next: tuple[Pose, Joints] | None = None
        self._joints: Joints | None = None
        self._rates: Joints = ()
        self._reserve: Sequence[Reserve] = ()
        axes = mechanism.axes
        limits = [x for one in axes for x in (one.low, one.high, one.velocity, one.acceleration)]
        self._limits = Rows(len(axes), 4, limits)
        self._last = Rows(2, len(axes))
        self._seconds, self._poses = Rows(_MOST, 1), Rows(_MOST, 7)
        self._along, self._strain = Rows(_MOST, len(axes)), array("d", bytes(32))

    def begin(self, before: Pose, sent: Pose, near: Joints) -> None:
        """Start from setpoints of another kind.

        Args:
            before: the setpoint before the last one: orientation, and position in m.
            sent: the last one.
            near: joints close to them, rad.
        """
        first = self._mechanism.nearest(*before, near)
        joints = None if first is None else self._mechanism.nearest(*sent, first)
        self._sent, self._next, self._joints = sent, None, None
        if first is not None and joints is not None:
            self._note(joints, first)

    def rest(self, sent: Pose) -> None:
        """Record that the axes have come to rest at the last setpoint, *sent*."""
        self._take(sent)
        if self._joints is not None:
            self._note(self._joints, self._joints)

    def look(self, sent: Pose, coming: ComingStop) -> str:
        """Return why the axes cannot follow the next setpoint, or an empty string.

        Args:
            sent: the last setpoint.
            coming: the next one, a period later, and a stop from there.
        """
        if sent != self._sent:
            self._take(sent)
        if self._joints is None:
            return "the device does not reach where it was sent"
        numbers = coming.numbers(self._period)
        count = self._kernels.foresee_stop(numbers, self._seconds.flat, self._poses.view)
        reached = self._mechanism.follow(self._poses, self._joints, self._along, count)
        self._next = None
        if reached:
            self._next = (coming.q, coming.position), self._along[0]
        problem = self._turning(reached) or self._nearing(reached)
        return problem or ("" if reached == count else "the device does not reach there")

    def _take(self, sent: Pose) -> None:
        """Record another setpoint."""
        before, self._sent = self._joints, sent
        if before is None:
            return
        if self._next is not None and self._next[0] == sent:
            found: Joints | None = self._next[1]
        else:
            found = self._mechanism.nearest(*sent, before)
        if found is not None:
            self._note(found, before)

    def _note(self, joints: Joints, before: Joints) -> None:
        """Record the axes at the last setpoint and, by those *before*, their rates."""
        rates = [(a - b) / self._period for a, b in zip(joints, before, strict=True)]
        self._joints, self._last = joints, Rows(2, len(joints), (*joints, *rates))
        self._reserve = self._mechanism.reserve(joints)

    def _turning(self, reached: int) -> str:
        """Return which axis is too fast, accelerates too much, or turns too far."""
        joints, last, limits = self._along.view[:reached], self._last.view, self._limits.view
        row = self._kernels.first_strain(
            self._seconds.flat, joints, last, limits, self._period, self._strain
        )
        if row == reached:
            return ""
        place, kind, value, most = self._strain
        return _STRAINS[int(kind)].format(self._mechanism.axes[int(place)].name, value, most)

    def _nearing(self, reached: int) -> str:
        """Return which singularity is too close, and closer than at the last setpoint."""
        kinds = len(self._reserve)
        if not (kinds and reached):
            return ""
        found = Rows(reached, kinds)
        self._mechanism.reserves(self._along, found, reached)
        for place, one in enumerate(self._reserve):
            value = min(found.flat[place::kinds])
            if value < one.least_followed and value < one.value:
                return f"the {one.name} would be {value:.3g} {one.unit} from its singularity"
        return ""


def refusal(mechanism: Mechanism, q: Quaternion, position: Vector3, joints: Joints) -> str:
    """Return why a device cannot reach a target, or an empty string.

    Args:
        mechanism: the device's mechanism.
        q: tool orientation.
        position: tool position, m.
        joints: current joints, rad.
    """
    found = mechanism.nearest(q, position, joints)
    if found is None:
        return "the device does not reach there"
    for axis, angle in zip(mechanism.axes, found, strict=True):
        if not axis.low <= angle <= axis.high:
            most = axis.high if angle > axis.high else axis.low
            return (
                f"{axis.name} would have to turn to {angle:.4g} rad, its range ends at {most:.4g}"
            )
    for one in mechanism.reserve(found):
        if one.value < one.least_followed:
            return (
                f"the {one.name} is {one.value:.3g} {one.unit} from its singularity there, the "
                f"least is {one.least_followed:g}"
            )
    return ""
