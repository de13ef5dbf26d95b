"""How to meet a target that may move: close in as much, and stop as much, as the limits allow."""

from __future__ import annotations

from math import cbrt, inf, sqrt

from orientd.driver import Vector3
from orientd.servo.tracking.law import reach, seek
from orientd.servo.tracking.law_bounds import Bounds

NEAR = 0.3
"""Angle left up to which what has followed closely is corrected without hurry, rad."""

SPIRAL = 0.6
"""Part of the closing speed that is given up while all the motion is across the way."""


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


def steer(
    e: Vector3,
    omega: Vector3,
    alpha: Vector3,
    omega_target: Vector3,
    alpha_target: Vector3,
    limits: Bounds,
    room: float = inf,
) -> tuple[Vector3, bool]:
    """Return the acceleration to aim at, to meet a moving target soonest and stay with it.

    It is as much as possible of what closes in, and as much as necessary of what stops (relative to
    the target), so that a stop from the next state does not pass the target.  Near the target,
    where no limit is in reach, a linear law takes its place, so that nothing chatters.

    Args:
        e: rotation vector from the orientation to the target's, rad.
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        omega_target: the target's angular velocity, rad/s.
        alpha_target: its angular acceleration, rad/s^2.
        limits: bounds.
        room: acceleration left for corrections of what follows the target closely, rad/s^2;
            infinity for what has to catch up with it.

    Returns:
        That acceleration, rad/s^2, and whether it is of the linear law.
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
        return seek(omega_target, omega, alpha, alpha_target, limits, limits.settle), True
    fx, fy, fz = fx / left, fy / left, fz / left
    s, calm = closing_speed(left, limits), limits.calm * limits.calm
    is_linear = limits.approach * left <= s and nx * nx + ny * ny + nz * nz <= max(s * s, calm)
    if is_linear or (room < inf and left < NEAR):
        k1, k2, k3 = limits.share, limits.settle, min(limits.approach * left, sqrt(room * left))
        gx, gy, gz = k2 * (k3 * fx - nx) - bx, k2 * (k3 * fy - ny) - by, k2 * (k3 * fz - nz) - bz
        return (alpha[0] + k1 * gx, alpha[1] + k1 * gy, alpha[2] + k1 * gz), True
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

    def excess(wanted: Vector3) -> float:
        rate = fx * wanted[0] + fy * wanted[1] + fz * wanted[2] - known
        stop = stopping_angle(speed + 0.5 * h * rate, rate, limits)
        return stop - angle + h * h * rate / 6.0

    over = excess(go)
    if over <= 0.0:
        return go, False
    halt = reach(alpha, seek(omega_target, omega, alpha, alpha_target, limits, 1.0 / h), limits)
    under = excess(halt)
    if under >= 0.0:
        return halt, False
    low, high = 0.0, 1.0
    wanted = halt
    for _ in range(5):
        share = low + (high - low) * under / (under - over)
        wanted = _between(halt, go, share)
        found = excess(wanted)
        if found > 0.0:
            high, over = share, found
        else:
            low, under = share, found
    return _between(halt, go, low), False


def _between(a: Vector3, b: Vector3, share: float) -> Vector3:
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
    )
