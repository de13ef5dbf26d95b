"""Keep tracked motion where a stop ends outside of the keep-out cones.

In every cycle the quickest stop from the next setpoint is rolled out
(``kernels/c/vector.h``).  If it would enter a cone, the step takes only a part
of the wanted change of velocity, so that the stop from there just stays outside.  The stop itself
is always such a step, so the device can stop outside at any time.
"""

from __future__ import annotations

from math import acos

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, cross, dot, norm, plus, rotate_back
from orientd.mechanism.mechanism import Rows
from orientd.servo.keep_out_cones import SLACK, KeepOutCones, Room
from orientd.servo.tracking.law import Law

RESERVE = 9e-4
"""Least angle outside of a cone that a stop keeps, rad: 0.05 degrees."""

_AGREEING = 2e-5
"""How much nearer a stop may come than foreseen, rad: a cone may turn."""

_PUSHES = (0.25, 1.0)
"""Shares of the largest acceleration away from a cone that are tried in turn."""


class StopFilter:
    """The largest part of a step from which a stop ends outside.

    Args:
        cones: the cones of the device.
        period: cycle period, s.

    Attributes:
        room: distance to the nearest cone at the last setpoint.
    """

    def __init__(self, cones: KeepOutCones, period: float) -> None:
        self._cones = cones
        self._period = period
        self.room = Room(cones)

    def filtered(
        self, q: Quaternion, omega: Vector3, alpha: Vector3, wanted: Vector3, law: Law
    ) -> Vector3:
        """Return the acceleration of the next step, *wanted* or nearer to that of a stop.

        Args:
            q: the last setpoint.
            omega: angular velocity of the last step, rad/s.
            alpha: angular acceleration of the last two steps, rad/s^2.
            wanted: acceleration of the next step, which the limits allow.
            law: has the limits of the step.
        """
        near = self._near(q, omega, law)
        if near is None:
            return wanted

        def margin(change: Vector3) -> float:
            return law.stop_clearance(plus(omega, change, self._period), change, near)

        missing = -margin(wanted)
        if missing <= 0.0:
            return wanted
        braked = law.halt(omega, alpha)
        found = margin(braked)
        if found > 0.0:
            # The margin is nearly linear in between.
            share = found / (found + missing)
            part = combine(braked, 1.0 - share, wanted, share)
            return part if margin(part) >= -_AGREEING else braked
        if found >= -_AGREEING:
            return braked
        outwards = _outwards(near)
        for push in _PUSHES:
            aside = law.halt(omega, alpha, plus(ZERO, outwards, push * law.acceleration))
            better = margin(aside)
            if better > found:
                braked, found = aside, better
            if found >= -_AGREEING:
                break
        return braked

    def is_clear(self, q: Quaternion, omega: Vector3, law: Law) -> bool:
        """Return whether no stop reaches a cone, in whatever direction."""
        return self._near(q, omega, law) is None

    def _near(self, q: Quaternion, omega: Vector3, law: Law) -> Rows | None:
        """Return the cones that a stop from the next step may reach; ``None`` for none."""
        reach = law.reach(omega) + RESERVE
        if not self.room.is_within(q, reach):
            return None
        near: list[float] = []
        cones = self._cones
        found = cones.clearances(q)
        for one, direction, clearance in zip(cones.cones, cones.directions, found, strict=True):
            if clearance <= reach:
                angle = one.half_angle + min(RESERVE, max(clearance, -SLACK))
                near += (*one.axis, *rotate_back(q, direction), angle)
        return Rows(len(near) // 7, 7, near) if near else None


def _outwards(near: Rows) -> Vector3:
    """Return the axis of the turn away from cones, the nearest ones first; of length 1 or zero."""
    total = ZERO
    for a, b, c, x, y, z, angle in (near[row] for row in range(len(near))):
        axis, direction = (a, b, c), (x, y, z)
        away = cross(direction, axis)
        size = norm(away)
        if size > 1e-9:
            gap = max(acos(max(-1.0, min(1.0, dot(axis, direction)))) - angle, 1e-4)
            total = plus(total, away, 1.0 / (size * gap))
    size = norm(total)
    return plus(ZERO, total, 1.0 / size) if size > 0.0 else ZERO
