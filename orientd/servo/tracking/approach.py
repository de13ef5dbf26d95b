"""How a position follows its target inside the limits of velocity and acceleration.

The velocity of the next step is the target's and as much more as still leaves the way to come to
rest relative to it.  No limit is ever exceeded, as no other velocity is ever chosen: a change that
is larger than the acceleration allows is cut to it.
"""

from __future__ import annotations

from math import sqrt

from orientd.driver import Vector3
from orientd.floats import norm

CLOSING = 10.0
"""Closing speed per distance left in the last stretch, 1/s."""

SETTLE = 60.0
"""Acceleration per error of the velocity, 1/s: what arrives in steps is not passed on in one."""

BRAKING = 0.7
"""Part of the acceleration that the way to rest is reckoned with; the rest is for what the target
does meanwhile."""


def approach(
    way: Vector3,
    velocity: Vector3,
    goal_velocity: Vector3,
    *,
    fastest: float,
    acceleration: float,
    period: float,
) -> Vector3:
    """Return the velocity of the next step towards a target, m/s.

    Args:
        way: from the position to the target's, m.
        velocity: of the last step, m/s; no more than *fastest*.
        goal_velocity: the target's, m/s.
        fastest: limit, m/s.
        acceleration: limit, m/s^2.
        period: of a cycle, s.
    """
    left = norm(way)
    brake = BRAKING * acceleration
    # Linear near the target, along the parabola of constant deceleration farther away.
    linear = brake / (CLOSING * CLOSING)
    speed = CLOSING * left if left < linear else sqrt(brake * (2.0 * left - linear))
    s = speed / left if left > 0.0 else 0.0
    x, y, z = (w + s * e for w, e in zip(goal_velocity, way, strict=True))
    size = norm((x, y, z))
    s = fastest / size if size > fastest else 1.0
    a, b, c = velocity
    x, y, z = s * x - a, s * y - b, s * z - c
    s = min(SETTLE * period, 1.0)
    size, most = s * norm((x, y, z)), acceleration * period
    if size > most:
        s *= most / size
    return (a + s * x, b + s * y, c + s * z)


def stopping_distance(speed: float, acceleration: float) -> float:
    """Return from how far away :func:`approach` brakes to a target at rest, m.

    Args:
        speed: m/s.
        acceleration: limit, m/s^2.
    """
    brake = BRAKING * acceleration
    linear = brake / (CLOSING * CLOSING)
    return speed / CLOSING if speed < CLOSING * linear else 0.5 * (speed * speed / brake + linear)
