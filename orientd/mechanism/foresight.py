"""Predict what followed targets demand of a mechanism's axes, from cycle to cycle.

Followed targets have no plan.  So the servo predicts the axes for each setpoint, and for the stop
that could follow it.  Plain floats only, since the servo process runs it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from orientd.driver import Joints, Quaternion, Vector3
from orientd.mechanism.mechanism import Mechanism

Pose = tuple[Quaternion, Vector3]

_SPEED_SHARE = 0.98
# The check looks at a few instants of a stop; between them an axis may be faster.
_STOP_SPEED_SHARE = 0.9
_STOP_ACCELERATION_SHARE = 0.5
# The first cycle of a stop is checked exactly.
_FIRST_ACCELERATION_SHARE = 0.7
# A device lags behind its setpoints, and stops at the very end of an axis' range.
_RANGE_MARGIN = 0.02
_STILL = 1e-9


class ComingPose(NamedTuple):
    """A pose that the device would be sent to soon.

    Attributes:
        seconds: time after the pose before it.
        q: orientation ``(w, x, y, z)``, tool to world.
        position: tool position in the world, m.
    """

    seconds: float
    q: Quaternion
    position: Vector3


class Foresight:
    """The axes at the last setpoint and at the next ones.

    Args:
        mechanism: kinematics and limits of the axes.
        period: cycle period, s.
    """

    def __init__(self, mechanism: Mechanism, period: float) -> None:
        self._mechanism = mechanism
        self._period = period
        self._sent: Pose | None = None
        self._next: tuple[Pose, Joints] | None = None
        self._joints: Joints | None = None
        self._rates: Joints = ()

    def begin(self, before: Pose, sent: Pose, near: Joints) -> None:
        """Start from setpoints of another kind.

        Args:
            before: the setpoint before the last one: orientation, and position in m.
            sent: the last one.
            near: joints close to them, rad.
        """
        first = self._mechanism.nearest(*before, near)
        self._joints = None if first is None else self._mechanism.nearest(*sent, first)
        self._sent, self._next = sent, None
        self._rates = self._rates_to(self._joints, first)

    def look(self, sent: Pose, coming: Sequence[ComingPose]) -> str:
        """Return why the axes cannot follow the next setpoint, or an empty string.

        Args:
            sent: the last setpoint.
            coming: the next one, a period later, and a stop from there at a few instants.
        """
        if sent != self._sent:
            self._take(sent)
        near, rates = self._joints, self._rates
        if near is None:
            return "the device does not reach where it was sent"
        before = self._period
        speed_share, change_share = _SPEED_SHARE, 1.0
        reserves = {one.name: one.value for one in self._mechanism.reserve(near)}
        self._next = None
        for place, (seconds, q, position) in enumerate(coming):
            # One after the other: the first one usually shows a problem.
            joints = self._mechanism.nearest(q, position, near)
            if joints is None:
                return "the device does not reach there"
            if not place:
                self._next = (q, position), joints
            moved = tuple((a - b) / seconds for a, b in zip(joints, near, strict=True))
            since = 0.5 * (seconds + before)
            problem = self._turning(joints, moved, rates, since, speed_share, change_share)
            problem = problem or self._nearing(joints, reserves)
            if problem:
                return problem
            near, rates, before = joints, moved, seconds
            speed_share = _STOP_SPEED_SHARE
            change_share = _STOP_ACCELERATION_SHARE if place else _FIRST_ACCELERATION_SHARE
        return ""

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
            self._joints, self._rates = found, self._rates_to(found, before)

    def _rates_to(self, joints: Joints | None, before: Joints | None) -> Joints:
        if joints is None or before is None:
            return (0.0,) * len(self._mechanism.axes)
        return tuple((a - b) / self._period for a, b in zip(joints, before, strict=True))

    def _turning(
        self,
        joints: Joints,
        moved: Joints,
        rates: Joints,
        since: float,
        speed_share: float,
        change_share: float,
    ) -> str:
        """Return which axis is too fast, accelerates too much, or turns too far."""
        for axis, angle, rate, last in zip(self._mechanism.axes, joints, moved, rates, strict=True):
            speed, most = abs(rate), speed_share * axis.velocity
            if speed > most and speed > abs(last):
                return f"{axis.name} would turn at {speed:.3g} rad/s, the limit is {most:.3g}"
            change, most = abs(rate - last) / since, change_share * axis.acceleration
            if change > most:
                return (
                    f"the speed of {axis.name} would change by {change:.3g} rad/s^2, the limit is "
                    f"{most:.3g}"
                )
            if (angle > axis.high - _RANGE_MARGIN and rate > _STILL) or (
                angle < axis.low + _RANGE_MARGIN and rate < -_STILL
            ):
                return f"{axis.name} is at the end of its range, {angle:.4g} rad"
        return ""

    def _nearing(self, joints: Joints, reserves: Mapping[str, float]) -> str:
        """Return which singularity is too close, and closer than by *reserves*."""
        for one in self._mechanism.reserve(joints):
            if one.value < one.least_followed and one.value < reserves[one.name]:
                return f"the {one.name} would be {one.value:.3g} {one.unit} from its singularity"
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
