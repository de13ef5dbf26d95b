"""The law that steers: which acceleration comes next, inside the limits by construction.

The motion is a chain of backward differences, exactly what the guard computes: ``alpha`` changes by
at most ``jerk * h`` a cycle, ``omega`` by ``alpha * h``, and the orientation turns by ``omega * h``
in its own frame.  All limits are Euclidean norms, so that nothing depends on a choice of axes;
where components have limits of their own, the law works in stretched coordinates whose ball lies
inside all of them (:func:`bounds_of`): a straight way to the target stays straight.

Between samples this chain is the same as an integrator with constant jerk, for the shifted
quantities ``omega - h alpha / 2`` and ``e + h omega - h^2 alpha / 6`` (e: what is left to turn);
with them the formulas of continuous time are exact at any rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import cbrt, sqrt
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.driver.floats import exp as rotation
from orientd.driver.floats import multiply, norm, normalize
from orientd.stream import Terms

_STILL = 1e-12
"""What counts as no velocity, rad/s: a thousandth of what the guard takes for rounding."""

PRECISION = 1e-3
"""Size of the last stretch, rad, where the law is linear; a slow device leaves it larger."""

QUICKEST = 0.15
"""Largest part of the angle left that the last stretch closes in one cycle."""

SOFT = 20.0
"""Largest closing speed per angle left while the target moves, 1/s."""

CALM = 0.5
"""Part of a limit that the linear law for a moving target may use up for a surprise."""

SPIRAL = 0.6
"""Part of the closing speed that is given up while all the motion is across the way."""

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
    jerk = min(jerk, acceleration / period)  # nothing is gained by more than that in a cycle
    approach = min(cbrt(jerk / PRECISION), sqrt(acceleration / PRECISION), QUICKEST / period)
    return Bounds(period, velocity, acceleration, jerk, approach, RATIO * approach, 0.8, 0.0)


def bounds_of(terms: Terms, period: float) -> tuple[Bounds, Vector3]:
    """Return bounds for *terms*, and the units along the axes in which they hold.

    An ellipsoid inside the limits of norm and components; along the axis that may move most it
    gives nothing away, along others as much as their limits are out of proportion.
    """
    if not terms.has_axes:
        return bounds(period, terms.velocity, terms.acceleration, terms.jerk), (1.0, 1.0, 1.0)
    velocity = min(terms.velocity, max(terms.axis_velocity))
    acceleration = min(terms.acceleration, max(terms.axis_acceleration))
    jerk = min(terms.jerk, max(terms.axis_jerk))
    x, y, z = (
        min(v / velocity, a / acceleration, j / jerk, 1.0)
        for v, a, j in zip(
            terms.axis_velocity, terms.axis_acceleration, terms.axis_jerk, strict=True
        )
    )
    return bounds(period, velocity, acceleration, jerk), (x, y, z)


def softened(limits: Bounds) -> Bounds:
    """Return *limits* with the gains for a target that moves and trembles."""
    approach = min(limits.approach, SOFT)
    share = min(limits.share, 3.0 * RATIO * approach * limits.period)
    settle = RATIO * approach
    calm = CALM * min(limits.acceleration / settle, limits.jerk / settle / settle)
    return limits._replace(approach=approach, settle=settle, share=share, calm=calm)


def loosened(limits: Bounds, omega: Vector3, alpha: Vector3) -> Bounds:
    """Return *limits*, or what a state outside them can keep."""
    size = norm(alpha)
    speed = norm(omega)
    if size > 0.0:
        s = limits.period * _run_out(size, limits.jerk * limits.period) / size
        speed = max(
            speed, norm((omega[0] + s * alpha[0], omega[1] + s * alpha[1], omega[2] + s * alpha[2]))
        )
    if speed <= limits.velocity and size <= limits.acceleration:
        return limits
    return limits._replace(
        velocity=max(speed, limits.velocity), acceleration=max(size, limits.acceleration)
    )


def push(change: float, limits: Bounds) -> float:
    """Return the acceleration with which a velocity changes by *change* without excess.

    Falling by ``jerk * h`` a cycle from the returned value, the acceleration is zero when the
    velocity has changed by *change*.
    """
    step = limits.jerk * limits.period
    total = change / limits.period
    if total <= step:
        return min(total, limits.acceleration)
    # m full cycles of ramp follow: total = (m + 1) value - step m (m + 1) / 2.
    m = int(0.5 * (sqrt(1.0 + 8.0 * total / step) - 1.0))
    return min(total / (m + 1) + 0.5 * step * m, limits.acceleration)


def closing_speed(angle: float, limits: Bounds) -> float:
    """Return the speed from which, unaccelerated, rest is reached within *angle*."""
    a, j = limits.acceleration, limits.jerk
    ramp = a * a / j
    if angle * j <= a * ramp:
        return cbrt(angle * angle * j)
    return sqrt(0.25 * ramp * ramp + 2.0 * a * angle) - 0.5 * ramp


def stopping_angle(speed: float, rate: float, limits: Bounds) -> float:
    """Return how far a motion about one axis still turns if it stops as soon as it can.

    Args:
        speed: rad/s, of the integrator in continuous time.
        rate: its acceleration, rad/s^2.
        limits: bounds.
    """
    a, j = limits.acceleration, limits.jerk
    if speed + 0.5 * rate * abs(rate) / j < 0.0:
        return -stopping_angle(-speed, -rate, limits)
    # The acceleration falls to -peak, stays there for a while if that is the limit, and rises.
    square = j * speed + 0.5 * rate * rate
    if square <= a * a:
        peak = sqrt(max(square, 0.0))
        t = (rate + peak) / j
        angle = t * (speed + t * (0.5 * rate - j * t / 6.0))
    else:
        peak = a
        t = (rate + a) / j
        angle = t * (speed + t * (0.5 * rate - j * t / 6.0))
        last, speed = 0.5 * a * a / j, speed + 0.5 * (rate * rate - a * a) / j
        angle += 0.5 * (speed * speed - last * last) / a
    return angle + peak * peak * peak / (6.0 * j * j)


def _run_out(value: float, step: float) -> float:
    """Return how much velocity (over h) is still gained while *value* ramps down to zero."""
    m = int(value / step)
    return m * (value - 0.5 * step * (m + 1))


def reach(alpha: Vector3, wish: Vector3, limits: Bounds) -> Vector3:
    """Return the acceleration nearest to *wish* that one cycle's jerk reaches."""
    step = limits.jerk * limits.period
    ax, ay, az = alpha
    dx, dy, dz = wish[0] - ax, wish[1] - ay, wish[2] - az
    change = sqrt(dx * dx + dy * dy + dz * dz)
    if change > step:
        s = step / change
        dx, dy, dz = s * dx, s * dy, s * dz
    x, y, z = ax + dx, ay + dy, az + dz
    size = sqrt(x * x + y * y + z * z)
    if size > limits.acceleration:
        s = limits.acceleration / size
        x, y, z = s * x, s * y, s * z
    return (x, y, z)


def advance(omega: Vector3, alpha: Vector3, wish: Vector3, limits: Bounds) -> Vector3:
    """Return the acceleration nearest to *wish* after which every limit can still be kept.

    From the state returned, ramping the acceleration to zero along its own direction keeps the
    velocity inside its ball: it moves along a chord.  So there is always a way on: that one.
    """
    step = limits.jerk * limits.period
    ax, ay, az = alpha
    x, y, z = reach(alpha, wish, limits)
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
        s = h * _run_out(size, limits.jerk * h) / size
        u, v, w = u + s * x, v + s * y, w + s * z
        return u * u + v * v + w * w <= top
    return True


def steer(
    e: Vector3,
    omega: Vector3,
    alpha: Vector3,
    omega_target: Vector3,
    alpha_target: Vector3,
    limits: Bounds,
) -> Vector3:
    """Return the acceleration to wish for, to meet a moving target soonest and stay with it.

    It is as much as possible of what closes in, and as much as necessary of what stops (relative to
    the target), so that a stop from the next state does not pass the target.

    Args:
        e: rotation vector from the orientation to the target's, rad.
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        omega_target: the target's angular velocity, rad/s.
        alpha_target: its angular acceleration, rad/s^2.
        limits: bounds.
    """
    h = limits.period
    nx, ny, nz = (
        omega[0] - omega_target[0],
        omega[1] - omega_target[1],
        omega[2] - omega_target[2],
    )
    bx, by, bz = alpha[0] - alpha_target[0], alpha[1] - alpha_target[1], alpha[2] - alpha_target[2]
    # Where the target is seen from when the acceleration has run out.
    t = sqrt(bx * bx + by * by + bz * bz) / limits.jerk
    s, r = h - t, -h * h / 6.0 - t * t / 3.0 + 0.5 * h * t
    fx, fy, fz = e[0] + s * nx + r * bx, e[1] + s * ny + r * by, e[2] + s * nz + r * bz
    left = sqrt(fx * fx + fy * fy + fz * fz)
    if left < 1e-150:
        return seek(omega_target, omega, alpha, alpha_target, limits, limits.settle)
    fx, fy, fz = fx / left, fy / left, fz / left
    s, calm = closing_speed(left, limits), limits.calm * limits.calm
    if limits.approach * left <= s and nx * nx + ny * ny + nz * nz <= max(s * s, calm):
        k1, k2, k3 = limits.share, limits.settle, limits.approach * left
        gx, gy, gz = k2 * (k3 * fx - nx) - bx, k2 * (k3 * fy - ny) - by, k2 * (k3 * fz - nz) - bz
        return (alpha[0] + k1 * gx, alpha[1] + k1 * gy, alpha[2] + k1 * gz)
    s = min(limits.approach * left, s)
    along = fx * nx + fy * ny + fz * nz
    across = sqrt(max(nx * nx + ny * ny + nz * nz - along * along, 0.0))
    s *= 1.0 - SPIRAL * across / (across + s)
    gx, gy, gz = omega_target[0] + s * fx, omega_target[1] + s * fy, omega_target[2] + s * fz
    speed = sqrt(gx * gx + gy * gy + gz * gz)
    s = limits.velocity / speed if speed > limits.velocity else 1.0
    goal = (s * gx, s * gy, s * gz)
    go = reach(alpha, seek(goal, omega, alpha, alpha_target, limits, limits.settle), limits)

    speed = fx * nx + fy * ny + fz * nz
    angle = fx * e[0] + fy * e[1] + fz * e[2]
    known = fx * alpha_target[0] + fy * alpha_target[1] + fz * alpha_target[2]

    def excess(wish: Vector3) -> float:
        rate = fx * wish[0] + fy * wish[1] + fz * wish[2] - known
        stop = stopping_angle(speed + 0.5 * h * rate, rate, limits)
        return stop - angle + h * h * rate / 6.0

    over = excess(go)
    if over <= 0.0:
        return go
    halt = reach(alpha, seek(omega_target, omega, alpha, alpha_target, limits, 1.0 / h), limits)
    under = excess(halt)
    if under >= 0.0:
        return halt
    low, high = 0.0, 1.0
    wish = halt
    for _ in range(5):
        share = low + (high - low) * under / (under - over)
        wish = _between(halt, go, share)
        found = excess(wish)
        if found > 0.0:
            high, over = share, found
        else:
            low, under = share, found
    return _between(halt, go, low)


def _between(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
    )


def seek(
    goal: Vector3,
    omega: Vector3,
    alpha: Vector3,
    alpha_target: Vector3,
    limits: Bounds,
    slope: float,
) -> Vector3:
    """Return the acceleration to wish for, to reach the angular velocity *goal* soonest.

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


def quickest_stop(
    q: Quaternion, omega: Vector3, alpha: Vector3, terms: Terms, period: float
) -> Iterator[Quaternion]:
    """Yield setpoints that come to rest as soon as the limits allow, wherever that is.

    Args:
        q: orientation last commanded.
        omega: angular velocity of the step to it, rad/s.
        alpha: change from the step before over the period, rad/s^2.
        terms: limits.
        period: s.
    """
    limits, units = bounds_of(terms, period)
    omega, alpha = divided(omega, units), divided(alpha, units)
    while omega != ZERO or alpha != ZERO:
        omega, alpha = halt(omega, alpha, loosened(limits, omega, alpha))
        x, y, z = times(omega, units)
        q = normalize(multiply(q, rotation((x * period, y * period, z * period))))
        yield q


def times(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in *units*, in SI."""
    return (v[0] * units[0], v[1] * units[1], v[2] * units[2])


def divided(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in SI, in *units*."""
    return (v[0] / units[0], v[1] / units[1], v[2] / units[2])


def halt(omega: Vector3, alpha: Vector3, limits: Bounds) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration one cycle further towards rest."""
    if norm(omega) < _STILL and norm(alpha) * limits.period < _STILL:
        return ZERO, ZERO
    wish = seek(ZERO, omega, alpha, ZERO, limits, 1.0 / limits.period)
    alpha = advance(omega, alpha, wish, limits)
    return moved(omega, alpha, limits.period), alpha


def moved(omega: Vector3, alpha: Vector3, period: float) -> Vector3:
    """Return the angular velocity after a cycle with the acceleration *alpha*."""
    return (
        omega[0] + period * alpha[0],
        omega[1] + period * alpha[1],
        omega[2] + period * alpha[2],
    )
