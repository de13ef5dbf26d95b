"""What the tracking law keeps, in its own units, and the gains of its last stretch."""

from __future__ import annotations

from math import cbrt, sqrt
from typing import NamedTuple

from orientd.driver import Vector3
from orientd.floats import norm
from orientd.stream import ServoLimits

PRECISION = 1e-3
"""Size of the last stretch, rad, where the law is linear; a slow device leaves it larger."""

QUICKEST = 0.27
"""Largest part of the angle left that the last stretch closes in one cycle."""

SOFT = 20.0
"""Largest closing speed per angle left while the target moves, 1/s."""

UNHURRIED = 0.8
"""Largest product of that speed per angle and of how long ago the target's motion is read: what is
known no sooner is corrected no faster, or every packet that is lost or late shows as a jerk."""

EVENLY = 2.0
"""How much faster the acceleration settles than the velocity, while the target moves."""

LEAST = 1e-9
"""The least that a limit counts as, so that none divides by zero."""

CALM = 0.5
"""Part of a limit that the linear law for a moving target may use up for a surprise."""

RATIO = 2.0
"""How much faster velocities settle than angles: with 2 no limit is asked for more than it gives
where a stop at the limits passes into the linear law."""


class Bounds(NamedTuple):
    """Norms that the motion keeps, and the gains of the last stretch.

    Attributes:
        period: s.
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.
        approach: closing speed per angle left, 1/s.
        settle: acceleration per velocity error, 1/s.
        share: part of the wanted change of acceleration that is made in one cycle.
        calm: relative speed below which the last stretch begins whatever the angle left, rad/s.
    """

    period: float
    velocity: float
    acceleration: float
    jerk: float
    approach: float
    settle: float
    share: float
    calm: float


def bounds(period: float, velocity: float, acceleration: float, jerk: float) -> Bounds:
    """Return bounds with the gains that suit them: the last stretch is some *PRECISION* long."""
    velocity, acceleration = max(velocity, LEAST), max(acceleration, LEAST)
    # A jerk that needs fewer than two cycles for the whole acceleration gains no time, and a stop
    # in whole cycles keeps less well to what is predicted of it.
    jerk = min(max(jerk, LEAST), acceleration / (2.0 * period))
    approach = min(cbrt(jerk / PRECISION), sqrt(acceleration / PRECISION), QUICKEST / period)
    return Bounds(period, velocity, acceleration, jerk, approach, RATIO * approach, 0.8, 0.0)


def bounds_of(servo_limits: ServoLimits, period: float) -> tuple[Bounds, Vector3]:
    """Return bounds for *servo_limits*, and the units along the axes in which they hold.

    An ellipsoid inside the limits of norm and components; along the axis that may move most it
    gives nothing away, along others as much as their limits are out of proportion.
    """
    if not servo_limits.has_axes:
        return bounds(
            period, servo_limits.velocity, servo_limits.acceleration, servo_limits.jerk
        ), (1.0, 1.0, 1.0)
    velocity = max(LEAST, min(servo_limits.velocity, max(servo_limits.axis_velocity)))
    acceleration = max(LEAST, min(servo_limits.acceleration, max(servo_limits.axis_acceleration)))
    jerk = max(LEAST, min(servo_limits.jerk, max(servo_limits.axis_jerk)))
    x, y, z = (
        max(LEAST, min(v / velocity, a / acceleration, j / jerk, 1.0))
        for v, a, j in zip(
            servo_limits.axis_velocity,
            servo_limits.axis_acceleration,
            servo_limits.axis_jerk,
            strict=True,
        )
    )
    return bounds(period, velocity, acceleration, jerk), (x, y, z)


def softened(limits: Bounds, delay: float) -> Bounds:
    """Return *limits* with the gains for a target that moves and trembles.

    Args:
        limits: with the gains for one at rest.
        delay: how long ago its motion is read, s.
    """
    approach = min(limits.approach, SOFT)
    if approach * delay > UNHURRIED:
        approach = UNHURRIED / delay
    share = min(limits.share, EVENLY * RATIO * approach * limits.period)
    settle = RATIO * approach
    calm = CALM * min(limits.acceleration / settle, limits.jerk / settle / settle)
    return limits._replace(approach=approach, settle=settle, share=share, calm=calm)


def loosened(limits: Bounds, omega: Vector3, alpha: Vector3) -> Bounds:
    """Return *limits*, or with the velocity that a state beyond them cannot avoid any more.

    An acceleration beyond them needs nothing: it falls as fast as the jerk allows (:func:`reach`).
    """
    size, speed = norm(alpha), norm(omega)
    if size > 0.0:
        s = limits.period * run_out(size, limits.jerk * limits.period) / size
        speed = max(
            speed, norm((omega[0] + s * alpha[0], omega[1] + s * alpha[1], omega[2] + s * alpha[2]))
        )
    return limits if speed <= limits.velocity else limits._replace(velocity=speed)


def run_out(value: float, step: float) -> float:
    """Return how much velocity (over h) is still gained while *value* ramps down to zero."""
    m = int(value / step)
    return m * (value - 0.5 * step * (m + 1))


def times(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in *units*, in SI."""
    return (v[0] * units[0], v[1] * units[1], v[2] * units[2])


def divided(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in SI, in *units*."""
    return (v[0] / units[0], v[1] / units[1], v[2] / units[2])
