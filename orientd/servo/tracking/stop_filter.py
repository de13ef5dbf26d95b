"""Keep tracked motion where a stop ends outside of the keep-out cones.

In every cycle the quickest stop from the next setpoint is foreseen
(:mod:`orientd.servo.tracking.stop_rollout`).  If it would enter a cone, the step takes only a part
of the wanted change of velocity, so that the stop from there just stays outside.  The stop itself
is always such a step, so the device can stop outside at any time.
"""

from __future__ import annotations

from math import acos

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, cross, dot, norm, plus, rotate_back
from orientd.servo.keep_out_cones import KeepOutCones, Room
from orientd.servo.motion_law import TrackingLimits, advance, halt, stopping_angle
from orientd.servo.tracking.stop_rollout import Obstacle, least_margin, stop_turns

RESERVE = 9e-4
"""Least angle outside of a cone that a stop keeps, rad: 0.05 degrees."""

_COARSE = 0.2
"""Addition to it, in units of acceleration times period squared: the stop is foreseen in continuous
time."""

_AGREEING = 2e-5
"""How much nearer a stop may come than foreseen, rad: the stop is not exactly as foreseen."""

_PUSHES = (0.25, 1.0)
"""Shares of the largest acceleration away from a cone that are tried in turn."""


class StopFilter:
    """The largest part of a step from which a stop ends outside.

    Args:
        cones: the cones of the device.
        period: cycle period, s.

    Attributes:
        room: distance to the nearest cone at the last setpoint.
        reserve: angle outside of a cone that a stop keeps, rad.
    """

    def __init__(self, cones: KeepOutCones, period: float) -> None:
        self._cones = cones
        self._period = period
        self.room = Room(cones)
        self.reserve = RESERVE

    def begin(self, limits: TrackingLimits, units: Vector3) -> None:
        """Begin with other limits, those of the law in *units*."""
        self._units = units
        self.reserve = RESERVE + _COARSE * limits.acceleration * self._period**2
        self.room.forget()

    def filtered(
        self, q: Quaternion, omega: Vector3, alpha: Vector3, wanted: Vector3, limits: TrackingLimits
    ) -> Vector3:
        """Return the acceleration of the next step, *wanted* or nearer to that of a stop.

        Args:
            q: the last setpoint.
            omega: angular velocity of the last step, in the units of the law.
            alpha: angular acceleration of the last two steps, in the units of the law.
            wanted: acceleration of the next step, which the limits allow.
            limits: limits of the step.
        """
        near = self._near(q, omega, limits)
        if not near:
            return wanted

        def margin(alpha: Vector3) -> float:
            return self._margin(omega, alpha, limits, near)

        missing = -margin(wanted)
        if missing <= 0.0:
            return wanted
        braked = halt(omega, alpha, limits)[1]
        found = margin(braked)
        if found > 0.0:
            # The margin is nearly linear in between.
            share = found / (found + missing)
            part = combine(braked, 1.0 - share, wanted, share)
            return part if margin(part) >= -_AGREEING else braked
        if found >= -_AGREEING:
            return braked
        for push in _PUSHES:
            aside = plus(braked, _outwards(near), push * limits.acceleration)
            aside = advance(omega, alpha, aside, limits)
            better = margin(aside)
            if better > found:
                braked, found = aside, better
            if found >= -_AGREEING:
                break
        return braked

    def is_clear(self, q: Quaternion, omega: Vector3, limits: TrackingLimits) -> bool:
        """Return whether no stop reaches a cone, in whatever direction."""
        return not self._near(q, omega, limits)

    def _margin(
        self, omega: Vector3, alpha: Vector3, limits: TrackingLimits, near: list[Obstacle]
    ) -> float:
        """Return by how much a stop stays clear after a step with *alpha*, rad."""
        after = plus(omega, alpha, self._period)
        return least_margin(stop_turns(after, alpha, limits, self._units), near)

    def _near(self, q: Quaternion, omega: Vector3, limits: TrackingLimits) -> list[Obstacle]:
        """Return the cones that a stop from the next step may reach."""
        h, most, jerk = self._period, limits.acceleration, limits.jerk
        # In its own units the law never turns by less than in radians.
        speed = norm(omega) + h * most
        reach = stopping_angle(speed, most, most, jerk) + h * speed + self.reserve
        if not self.room.is_within(q, reach):
            return []
        near = []
        cones = self._cones
        found = cones.clearances(q)
        for one, direction, clearance in zip(cones.cones, cones.directions, found, strict=True):
            if clearance <= reach:
                # From inside, the tool must not come any nearer.
                angle = one.half_angle + min(self.reserve, clearance)
                near.append(Obstacle(one.axis, rotate_back(q, direction), angle))
        return near


def _outwards(near: list[Obstacle]) -> Vector3:
    """Return the axis of the turn away from cones, the nearest ones first; of length 1 or zero."""
    total = ZERO
    for axis, direction, angle in near:
        away = cross(direction, axis)
        size = norm(away)
        if size > 1e-9:
            gap = max(acos(max(-1.0, min(1.0, dot(axis, direction)))) - angle, 1e-4)
            total = plus(total, away, 1.0 / (size * gap))
    size = norm(total)
    return plus(ZERO, total, 1.0 / size) if size > 0.0 else ZERO
