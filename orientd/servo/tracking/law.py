"""The law of motion: which acceleration comes next, inside the limits by construction.

The motion is a chain of backward differences, exactly what the guard computes: ``alpha`` changes by
at most ``jerk * h`` a cycle, ``omega`` by ``alpha * h``, and the orientation turns by ``omega * h``
in its own frame.  All limits are Euclidean norms, so that nothing depends on a choice of axes;
where components have limits of their own, the law works in stretched coordinates whose ball lies
inside all of them (:func:`~orientd.servo.tracking.law_bounds.bounds_of`): a straight way to the
target stays straight.

Between samples this chain is the same as an integrator with constant jerk, for the shifted
quantities ``omega - h alpha / 2`` and ``e + h omega - h^2 alpha / 6`` (e: what is left to turn);
with them the formulas of continuous time are exact at any rate.
"""

from __future__ import annotations

from math import sqrt

from orientd.driver import ZERO, Vector3
from orientd.floats import norm, plus
from orientd.servo.double_s import first_change
from orientd.servo.tracking.law_bounds import Bounds, run_out

_STILL = 1e-12
"""What counts as no velocity, rad/s: a thousandth of what the guard takes for rounding."""


def push(change: float, limits: Bounds) -> float:
    """Return the acceleration with which a velocity changes by *change* without excess.

    Falling by ``jerk * h`` a cycle from the returned value, the acceleration is zero when the
    velocity has changed by *change*.
    """
    wanted = first_change(change / limits.period, limits.jerk * limits.period)
    return min(wanted, limits.acceleration)


def reach(alpha: Vector3, wanted: Vector3, limits: Bounds) -> Vector3:
    """Return how far one cycle's jerk gets from *alpha* towards *wanted*, cut to the limit."""
    step = limits.jerk * limits.period
    x, y, z = wanted
    size = sqrt(x * x + y * y + z * z)
    if size > limits.acceleration:
        s = limits.acceleration / size
        x, y, z = s * x, s * y, s * z
    ax, ay, az = alpha
    dx, dy, dz = x - ax, y - ay, z - az
    change = sqrt(dx * dx + dy * dy + dz * dz)
    if change > step:
        s = step / change
        return (ax + s * dx, ay + s * dy, az + s * dz)
    return (x, y, z)


def advance(omega: Vector3, alpha: Vector3, wanted: Vector3, limits: Bounds) -> Vector3:
    """Return the acceleration nearest to *wanted* after which every limit can still be kept.

    From the state returned, ramping the acceleration to zero along its own direction keeps the
    velocity inside its ball: it moves along a chord.  So there is always a way on: that one.
    """
    step = limits.jerk * limits.period
    ax, ay, az = alpha
    x, y, z = reach(alpha, wanted, limits)
    if _stays(omega, x, y, z, limits):
        return (x, y, z)
    size = sqrt(ax * ax + ay * ay + az * az)
    s = 1.0 - step / size if size > step else 0.0
    bx, by, bz = s * ax, s * ay, s * az
    low, high = 0.0, 1.0
    for _ in range(10):
        share = 0.5 * (low + high)
        if _stays(
            omega, bx + share * (x - bx), by + share * (y - by), bz + share * (z - bz), limits
        ):
            low = share
        else:
            high = share
    return (bx + low * (x - bx), by + low * (y - by), bz + low * (z - bz))


def _stays(omega: Vector3, x: float, y: float, z: float, limits: Bounds) -> bool:
    h, top = limits.period, limits.velocity * limits.velocity
    u, v, w = omega[0] + h * x, omega[1] + h * y, omega[2] + h * z
    if u * u + v * v + w * w > top:
        return False
    size = sqrt(x * x + y * y + z * z)
    if size > limits.jerk * h:
        s = h * run_out(size, limits.jerk * h) / size
        u, v, w = u + s * x, v + s * y, w + s * z
        return u * u + v * v + w * w <= top
    return True


def seek(
    goal: Vector3,
    omega: Vector3,
    alpha: Vector3,
    alpha_target: Vector3,
    limits: Bounds,
    slope: float,
) -> Vector3:
    """Return the acceleration to aim at, to reach the angular velocity *goal* soonest.

    The acceleration goes straight to a turning point and from there straight to zero, in the space
    of accelerations; which one, two rounds of a fixed-point iteration find.  About one axis this is
    the quickest there is.
    """
    h, jerk = limits.period, limits.jerk
    a, b, c = alpha_target
    u, v, w = alpha[0] - a, alpha[1] - b, alpha[2] - c
    dx, dy, dz = x, y, z = goal[0] - omega[0], goal[1] - omega[1], goal[2] - omega[2]
    for rounds_left in (2, 1, 0):
        change = sqrt(x * x + y * y + z * z)
        s = min(push(change, limits) / change, slope) if change > 1e-150 else 0.0
        mx, my, mz = s * x, s * y, s * z
        way = sqrt((mx - u) * (mx - u) + (my - v) * (my - v) + (mz - w) * (mz - w))
        t = 0.5 * (way / jerk - h)
        if not rounds_left or t <= 0.0:
            break
        # What the way to the turning point does to the velocity; half of it, or it would swing.
        x = 0.5 * (x + dx - t * (u + mx))
        y = 0.5 * (y + dy - t * (v + my))
        z = 0.5 * (z + dz - t * (w + mz))
    return (a + mx, b + my, c + mz)


def halt(omega: Vector3, alpha: Vector3, limits: Bounds) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration one cycle further towards rest."""
    if norm(omega) < _STILL and norm(alpha) * limits.period < _STILL:
        return ZERO, ZERO
    wanted = seek(ZERO, omega, alpha, ZERO, limits, 1.0 / limits.period)
    alpha = advance(omega, alpha, wanted, limits)
    return plus(omega, alpha, limits.period), alpha
