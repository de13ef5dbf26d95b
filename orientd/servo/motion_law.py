"""The law of motion: limits and gains, and which acceleration comes next, inside the limits.

The motion is a chain of backward differences, exactly what the guard computes: ``alpha`` changes by
at most ``jerk * h`` a cycle, ``omega`` by ``alpha * h``, and the orientation turns by ``omega * h``
in its own frame.  All limits are Euclidean norms, so that nothing depends on a choice of axes.  If
components have limits of their own, the law works in scaled coordinates whose ball lies inside all
of them (:func:`limits_of`): a straight way to the target stays straight.

About one axis a stop in whole cycles changes the velocity by *c*, *c - d*, *c - 2d*, ... (*d* is
what the jerk allows): :func:`first_change`.  Between samples this chain is the same as an
integrator with constant jerk, for the shifted quantities ``omega - h alpha / 2`` and ``e + h omega
- h^2 alpha / 6`` (e: what is left to turn); with them the formulas of continuous time are exact at
any rate: :func:`stop_phases`, :func:`stopping_angle`.
"""

from __future__ import annotations

from math import cbrt, floor, sqrt
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import norm, plus
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

_STRAIGHT = 1e-6  # sine of an angle
_STILL = 1e-12
"""What counts as no velocity, rad/s: a thousandth of what the guard takes for rounding."""

CALM = 0.5
"""Part of a limit that the linear law for a moving target may use up for a surprise."""

RATIO = 2.0
"""How much faster velocities settle than angles: with 2 no limit is asked for more than it gives
where a stop at the limits passes into the linear law."""


class TrackingLimits(NamedTuple):
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


def limits_of(servo_limits: ServoLimits, period: float) -> tuple[TrackingLimits, Vector3]:
    """Return *servo_limits* for the law, and the units along the axes in which they hold.

    An ellipsoid inside the limits of norm and components; along the axis that may move most it
    gives nothing away, along others as much as their limits are out of proportion.  The gains are
    those for a target at rest: the last stretch is *PRECISION* long.
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
    # A jerk that needs fewer than two cycles for the whole acceleration gains no time, and a stop
    # in whole cycles keeps less well to what is predicted of it.
    jerk = min(jerk, acceleration / (2.0 * period))
    approach = min(cbrt(jerk / PRECISION), sqrt(acceleration / PRECISION), QUICKEST / period)
    limits = TrackingLimits(
        period, velocity, acceleration, jerk, approach, RATIO * approach, 0.8, 0.0
    )
    return limits, units


def softened(limits: TrackingLimits, delay: float) -> TrackingLimits:
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


def first_change(total: float, step: float) -> float:
    """Return the change with which a velocity begins to change by *total* without excess.

    The changes *c, c-d, c-2d, ...* of the cycles to come cover ``(n+1)(c - d n/2)``,
    ``n = floor(c/d)``.

    Args:
        total: of all the changes; not negative.
        step: *d*, how much the jerk lets the change differ from one cycle to the next.
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
    """Return for how long a stop's acceleration falls, stays and rises, s.

    Args:
        speed: not negative, or becoming so before the acceleration has run out.
        rate: at which the speed changes at first.
        acceleration: limit.
        jerk: limit.
    """
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    held = (square - peak * peak) / (peak * jerk) if peak > 0.0 else 0.0
    return max((rate + peak) / jerk, 0.0), held, peak / jerk


def stopping_angle(speed: float, rate: float, acceleration: float, jerk: float) -> float:
    """Return how far a motion about one axis still turns if it stops as soon as it can, rad.

    Args:
        speed: rad/s, of either sign.
        rate: its acceleration, rad/s^2.
        acceleration: limit, rad/s^2.
        jerk: limit, rad/s^3.
    """
    if speed + 0.5 * rate * abs(rate) / jerk < 0.0:
        return -stopping_angle(-speed, -rate, acceleration, jerk)
    # As stop_phases() says, in one piece: the tracker asks several times a cycle.
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
    """Return *limits*, or with the velocity that a state beyond them cannot avoid any more.

    An acceleration beyond them needs nothing: it falls as fast as the jerk allows.
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


def advance(omega: Vector3, alpha: Vector3, wanted: Vector3, limits: TrackingLimits) -> Vector3:
    """Return the acceleration nearest to *wanted* after which every limit can still be kept.

    From the state returned, ramping the acceleration to zero along its own direction keeps the
    velocity inside its ball: it moves along a chord.  So there is always a way on: that one.
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

    The acceleration goes straight to a turning point and from there straight to zero, in the space
    of accelerations; which one, two rounds of a fixed-point iteration find.  About one axis this is
    the quickest there is.  Never more than *slope* times what is left of the velocity.
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
        # What the way to the turning point does to the velocity; half of it, or it would swing.
        x = 0.5 * (x + dx - t * (u + mx))
        y = 0.5 * (y + dy - t * (v + my))
        z = 0.5 * (z + dz - t * (w + mz))
    return (a + mx, b + my, c + mz)


def halt(omega: Vector3, alpha: Vector3, limits: TrackingLimits) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration one cycle further towards rest."""
    if norm(omega) < _STILL and norm(alpha) * limits.period < _STILL:
        return ZERO, ZERO
    wanted = velocity_command(ZERO, omega, alpha, ZERO, limits, 1.0 / limits.period)
    alpha = advance(omega, alpha, wanted, limits)
    return plus(omega, alpha, limits.period), alpha


def halt_inside(
    omega: Vector3, alpha: Vector3, servo_limits: ServoLimits, period: float
) -> tuple[Vector3, Vector3]:
    """Return velocity and acceleration one cycle further towards rest, in limits of components.

    The stop goes along the line of the velocity, with all that the limits allow along it.  An
    acceleration across that line is taken away first.
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
