"""The law of motion: limits and gains, and the next acceleration within the limits.

The motion is a chain of backward differences, exactly as the guard computes them.  In each cycle
``alpha`` changes by at most ``jerk * h``, ``omega`` by ``alpha * h``, and the orientation turns by
``omega * h`` in its own frame.  All limits are Euclidean norms, so the choice of axes does not
matter. If components have their own limits, the law works in scaled coordinates whose ball lies
inside all of them (:func:`limits_of`).  A straight path to the target stays straight.

About one axis, a stop in whole cycles changes the velocity by *c*, *c - d*, *c - 2d*, ..., where
*d* is what the jerk allows: :func:`first_change`.  Between samples this chain equals an integrator
with constant jerk, for the shifted quantities ``omega - h alpha / 2`` and ``e + h omega - h^2 alpha
/ 6`` (e: the remaining angle).  With them the formulas of continuous time are exact at any rate:
:func:`stop_phases`, :func:`stopping_angle`.
"""

from __future__ import annotations

from math import cbrt, floor, sqrt
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import norm, plus
from orientd.stream.records import ServoLimits

PRECISION = 1e-3
"""Size of the final approach, rad, where the law is linear; larger for a slow device."""

QUICKEST = 0.27
"""Largest share of the remaining angle that the final approach covers in one cycle."""

SOFT = 20.0
"""Largest closing speed per remaining angle while the target moves, 1/s."""

UNHURRIED = 0.8
"""Largest product of that speed per angle and of the delay at which the target's motion is read.

A faster correction of such old information would show every lost or late packet as a jerk.
"""

EVENLY = 2.0
"""How much faster the acceleration settles than the velocity, while the target moves."""

LEAST = 1e-9
"""Smallest value of a limit, to avoid division by zero."""

NO_LIMITS = ServoLimits(LEAST, LEAST, LEAST, LEAST, LEAST, 1.0)
"""Limits before the first motion."""

_STRAIGHT = 1e-6  # sine of an angle
_STILL = 1e-12
"""Angular velocity that counts as zero, rad/s: a thousandth of the guard's rounding."""

CALM = 0.5
"""Share of a limit that the linear law for a moving target may use for a surprise."""

RATIO = 2.0
"""How much faster velocities settle than angles.

With 2, a stop at the limits continues in the linear law without exceeding a limit.
"""


class TrackingLimits(NamedTuple):
    """The norms that the motion keeps, and the gains of the final approach.

    Attributes:
        period: s.
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.
        approach: closing speed per remaining angle, 1/s.
        settle: acceleration per velocity error, 1/s.
        share: share of the wanted change of acceleration made in one cycle.
        calm: relative speed below which the final approach begins at any remaining angle, rad/s.
    """

    period: float
    velocity: float
    acceleration: float
    jerk: float
    approach: float
    settle: float
    share: float
    calm: float


def limits_of(servo_limits: ServoLimits, period: float) -> tuple[TrackingLimits, Vector3]:
    """Return *servo_limits* for the law, and the units along the axes in which they hold.

    This is an ellipsoid within the limits of norm and components.  It uses the full limit along the
    axis with the largest one, and less along others if their limits are out of proportion.  The
    gains are those for a target at rest: the final approach is *PRECISION* long.
    """
    norms = servo_limits.velocity, servo_limits.acceleration, servo_limits.jerk
    units = (1.0, 1.0, 1.0)
    if servo_limits.has_axes:
        axes = servo_limits.axis_velocity, servo_limits.axis_acceleration, servo_limits.axis_jerk
        balls = [max(LEAST, min(most, max(each))) for most, each in zip(norms, axes, strict=True)]
        x, y, z = (
            max(LEAST, min(1.0, *(part / ball for part, ball in zip(parts, balls, strict=True))))
            for parts in zip(*axes, strict=True)
        )
        norms, units = (balls[0], balls[1], balls[2]), (x, y, z)
    velocity, acceleration, jerk = (max(limit, LEAST) for limit in norms)
    # A jerk that reaches the full acceleration in less than two cycles saves no time, and a stop in
    # whole cycles would follow its prediction less exactly.
    jerk = min(jerk, acceleration / (2.0 * period))
    approach = min(cbrt(jerk / PRECISION), sqrt(acceleration / PRECISION), QUICKEST / period)
    limits = TrackingLimits(
        period, velocity, acceleration, jerk, approach, RATIO * approach, 0.8, 0.0
    )
    return limits, units


def linear_limits_of(servo_limits: ServoLimits, period: float) -> TrackingLimits:
    """Return the limits of the position for the law.

    No limit of a device speaks of the jerk of its position: the acceleration is built up in the
    same time as that of the orientation.
    """
    acceleration = servo_limits.linear_acceleration
    jerk = acceleration * servo_limits.jerk / max(servo_limits.acceleration, LEAST)
    velocity = servo_limits.linear_velocity
    limits, _ = limits_of(ServoLimits(velocity, acceleration, jerk, 0.0, 0.0, 0.0), period)
    return limits


def softened(limits: TrackingLimits, delay: float) -> TrackingLimits:
    """Return *limits* with the gains for a moving, noisy target.

    Args:
        limits: with the gains for a target at rest.
        delay: age at which its motion is read, s.
    """
    approach = min(limits.approach, SOFT)
    if approach * delay > UNHURRIED:
        approach = UNHURRIED / delay
    share = min(limits.share, EVENLY * RATIO * approach * limits.period)
    settle = RATIO * approach
    calm = CALM * min(limits.acceleration / settle, limits.jerk / settle / settle)
    return limits._replace(approach=approach, settle=settle, share=share, calm=calm)


def first_change(total: float, step: float) -> float:
    """Return the first of the changes by which a velocity changes by *total* without overshoot.

    The changes *c, c-d, c-2d, ...* of the next cycles sum up to ``(n+1)(c - d n/2)``, ``n =
    floor(c/d)``.

    Args:
        total: sum of all the changes; not negative.
        step: *d*, the largest difference of changes in two cycles, by the jerk.
    """
    left = total / step
    whole = floor(0.5 * (sqrt(1.0 + 8.0 * left) - 1.0))
    return (left / (whole + 1) + 0.5 * whole) * step


def run_out(change: float, step: float) -> float:
    """Return the sum of the changes *c - d, c - 2d, ...* that follow the *change* c."""
    m = int(change / step)
    return m * (change - 0.5 * step * (m + 1))


def stop_phases(
    speed: float, rate: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Return the durations of falling, constant and rising acceleration in a stop, s.

    Args:
        speed: not negative, or becoming so before the acceleration has run out.
        rate: initial rate of the speed.
        acceleration: limit.
        jerk: limit.
    """
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    held = (square - peak * peak) / (peak * jerk) if peak > 0.0 else 0.0
    return max((rate + peak) / jerk, 0.0), held, peak / jerk


def stopping_angle(speed: float, rate: float, acceleration: float, jerk: float) -> float:
    """Return the remaining turn of a motion about one axis that stops as soon as it can, rad.

    Args:
        speed: rad/s, of either sign.
        rate: its acceleration, rad/s^2.
        acceleration: limit, rad/s^2.
        jerk: limit, rad/s^3.
    """
    if speed + 0.5 * rate * abs(rate) / jerk < 0.0:
        return -stopping_angle(-speed, -rate, acceleration, jerk)
    # The formulas of stop_phases() inline: the tracker needs them several times a cycle.
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    t = (rate + peak) / jerk
    last = 0.5 * peak * peak / jerk
    angle = t * (speed + t * (0.5 * rate - jerk * t / 6.0)) + last * peak / (3.0 * jerk)
    if peak == acceleration:
        speed += 0.5 * (rate * rate - peak * peak) / jerk
        angle += 0.5 * (speed * speed - last * last) / peak
    return angle


def loosened(limits: TrackingLimits, omega: Vector3, alpha: Vector3) -> TrackingLimits:
    """Return *limits*, with the velocity raised to the least that a state can still keep.

    An acceleration beyond them needs no change: it falls as fast as the jerk allows.
    """
    size, speed = norm(alpha), norm(omega)
    if size > 0.0:
        s = limits.period * run_out(size, limits.jerk * limits.period) / size
        speed = max(speed, norm(plus(omega, alpha, s)))
    return limits if speed <= limits.velocity else limits._replace(velocity=speed)


def times(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in *units*, in SI."""
    return (v[0] * units[0], v[1] * units[1], v[2] * units[2])


def divided(v: Vector3, units: Vector3) -> Vector3:
    """Return *v*, given in SI, in *units*."""
    return (v[0] / units[0], v[1] / units[1], v[2] / units[2])


def saturated(alpha: Vector3, wanted: Vector3, limits: TrackingLimits) -> Vector3:
    """Return *alpha* moved towards *wanted* by at most one cycle's jerk, and inside the limit."""
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


def advance(omega: Vector3, alpha: Vector3, wanted: Vector3, limits: TrackingLimits) -> Vector3:
    """Return the acceleration nearest to *wanted* that still allows keeping every limit.

    From the returned state, ramping the acceleration to zero along its own direction keeps the
    velocity inside its ball: it moves along a chord.  So a feasible continuation always exists.
    """
    step = limits.jerk * limits.period
    ax, ay, az = alpha
    x, y, z = saturated(alpha, wanted, limits)
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


def _stays(omega: Vector3, x: float, y: float, z: float, limits: TrackingLimits) -> bool:
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


def velocity_command(
    goal: Vector3,
    omega: Vector3,
    alpha: Vector3,
    alpha_target: Vector3,
    limits: TrackingLimits,
    slope: float,
) -> Vector3:
    """Return the acceleration to aim at, to reach the angular velocity *goal* soonest.

    In the space of accelerations, it goes straight to a turning point and from there straight to
    zero. Two rounds of a fixed-point iteration find the turning point.  About one axis this is the
    optimum. The result is at most *slope* times the remaining velocity.
    """
    h, jerk = limits.period, limits.jerk
    step = jerk * h
    a, b, c = alpha_target
    u, v, w = alpha[0] - a, alpha[1] - b, alpha[2] - c
    dx, dy, dz = x, y, z = goal[0] - omega[0], goal[1] - omega[1], goal[2] - omega[2]
    for rounds_left in (2, 1, 0):
        change = sqrt(x * x + y * y + z * z)
        s = 0.0
        if change > 1e-150:
            s = min(first_change(change / h, step), limits.acceleration) / change
            s = min(s, slope)
        mx, my, mz = s * x, s * y, s * z
        way = sqrt((mx - u) * (mx - u) + (my - v) * (my - v) + (mz - w) * (mz - w))
        t = 0.5 * (way / jerk - h)
        if not rounds_left or t <= 0.0:
            break
        # The velocity change until the turning point; only half of it, to avoid oscillation.
        x = 0.5 * (x + dx - t * (u + mx))
        y = 0.5 * (y + dy - t * (v + my))
        z = 0.5 * (z + dz - t * (w + mz))
    return (a + mx, b + my, c + mz)


def halt(omega: Vector3, alpha: Vector3, limits: TrackingLimits) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration after one more cycle towards rest."""
    if norm(omega) < _STILL and norm(alpha) * limits.period < _STILL:
        return ZERO, ZERO
    wanted = velocity_command(ZERO, omega, alpha, ZERO, limits, 1.0 / limits.period)
    alpha = advance(omega, alpha, wanted, limits)
    return plus(omega, alpha, limits.period), alpha


def halt_inside(
    omega: Vector3, alpha: Vector3, servo_limits: ServoLimits, period: float
) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration after one more cycle towards rest, with component limits.

    The stop follows the line of the velocity at the full limits along it.  An acceleration across
    that line is removed first.
    """
    (a, b, c), (x, y, z) = omega, alpha
    normal = norm((b * z - c * y, c * x - a * z, a * y - b * x))
    is_across = normal > _STRAIGHT * norm(omega) * norm(alpha)
    line = alpha if is_across or omega == ZERO else omega
    size = norm(line) or 1.0

    def along(most: float, axes: Vector3) -> float:
        parts = zip(axes, line, strict=True)
        return min([most, *(axis * size / abs(part) for axis, part in parts if part)])

    velocity = along(servo_limits.velocity, servo_limits.axis_velocity)
    acceleration = along(servo_limits.acceleration, servo_limits.axis_acceleration)
    jerk = along(servo_limits.jerk, servo_limits.axis_jerk)
    limits, _ = limits_of(ServoLimits(velocity, acceleration, jerk, 0.0, 0.0, 0.0), period)
    if not is_across:
        return halt(omega, alpha, loosened(limits, omega, alpha))
    alpha = saturated(alpha, ZERO, limits)
    return plus(omega, alpha, period), alpha
