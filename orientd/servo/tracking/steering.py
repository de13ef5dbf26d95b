"""The position controller: meet a target that may move as soon as the limits allow.

Lost or late packets are surprises: the target turns out to be elsewhere than expected.  While the
device follows a moving target closely, an :class:`AccelerationCap` limits corrections.  The total
acceleration, including the target's own, stays below the target's recent maximum.  So a bad network
causes no acceleration peak.  While the target accelerates at its maximum, the correction waits.
"""

from __future__ import annotations

from math import cbrt, inf, sqrt

from orientd.driver import Vector3
from orientd.floats import combine, dot, norm, plus
from orientd.servo.motion_law import (
    TrackingLimits,
    saturated,
    stopping_angle,
    velocity_command,
)

NEAR = 0.3
"""Remaining angle up to which a close follower corrects slowly, rad."""

SPIRAL = 0.6
"""Share of the closing speed that is given up while all the motion is sideways."""

FORGETTING = 0.02
"""Share of the target's largest acceleration that is forgotten in a second."""

LEAST_PART = 0.05
"""Share of the limit that a correction may always use, and a stop relative to a target."""


class AccelerationCap:
    """The largest acceleration of the target, and whether the device follows it closely.

    It follows closely once the correction of angle and velocity takes no more than the target's own
    acceleration.  It no longer does when the tracker has to catch up with the full limits.
    """

    def __init__(self, period: float) -> None:
        """Create it for one target per *period* seconds."""
        self._kept = 1.0 - FORGETTING * period
        self.release()

    def release(self) -> None:
        """Start to catch up with another target."""
        self._largest = 0.0
        self._is_close = False

    def margin(self, alpha: Vector3, needed: float, limit: float) -> float:
        """Return the acceleration available for a correction; infinity while catching up.

        *alpha* is that of the target.  Correcting angle and velocity, each by itself, takes
        *needed*; infinity if nothing has to be restrained.  All in rad/s^2.
        """
        size = norm(alpha)
        self._largest = max(size, self._kept * self._largest, LEAST_PART * limit)
        self._is_close = needed < inf and (self._is_close or needed <= self._largest)
        return self._largest - size if self._is_close else inf

    def capped(self, wanted: Vector3, *, is_linear: bool) -> Vector3:
        """Return the acceleration to aim at, with the correction capped at the target's own."""
        self._is_close = self._is_close and is_linear
        size = norm(wanted)
        if not self._is_close or size <= self._largest:
            return wanted
        s = self._largest / size
        return (s * wanted[0], s * wanted[1], s * wanted[2])


def closing_speed(angle: float, a: float, j: float) -> float:
    """Return the speed from which, without initial acceleration, a stop fits within *angle*.

    The stop has at most the acceleration *a*, rad/s^2, and the jerk *j*, rad/s^3.
    """
    ramp = a * a / j
    if angle * j <= a * ramp:
        return cbrt(angle * angle * j)
    return sqrt(0.25 * ramp * ramp + 2.0 * a * angle) - 0.5 * ramp


def position_command(
    e: Vector3,
    omega: Vector3,
    alpha: Vector3,
    omega_target: Vector3,
    alpha_target: Vector3,
    limits: TrackingLimits,
    margin: float = inf,
) -> tuple[Vector3, bool]:
    """Return the acceleration to aim at, to meet a moving target soonest and stay with it.

    It closes in as fast as possible, but brakes as much as necessary, relative to the target.  A
    stop from the next state thus never passes the target.  The target's own acceleration is not
    available for that stop.  Near the target no limit is active, and a linear law takes over to
    avoid chatter.

    Args:
        e: rotation vector from the orientation to the target's, rad.
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        omega_target: the target's angular velocity, rad/s.
        alpha_target: its angular acceleration, rad/s^2.
        limits: the limits and gains.
        margin: acceleration available for corrections of a close follower, rad/s^2; infinity while
            it catches up.

    Returns:
        That acceleration, rad/s^2, and whether it comes from the linear law.
    """
    h = limits.period
    nx, ny, nz = plus(omega, omega_target, -1.0)
    bx, by, bz = plus(alpha, alpha_target, -1.0)
    # The error after the acceleration has run out.
    t = sqrt(bx * bx + by * by + bz * bz) / limits.jerk
    s, r = h - t, -h * h / 6.0 - t * t / 3.0 + 0.5 * h * t
    fx, fy, fz = e[0] + s * nx + r * bx, e[1] + s * ny + r * by, e[2] + s * nz + r * bz
    left = sqrt(fx * fx + fy * fy + fz * fz)
    if left < 1e-150:
        return velocity_command(
            omega_target, omega, alpha, alpha_target, limits, limits.settle
        ), True
    fx, fy, fz = fx / left, fy / left, fz / left
    most = limits.acceleration
    most = max(most - norm(alpha_target), LEAST_PART * most)
    s, calm = closing_speed(left, most, limits.jerk), limits.calm * limits.calm
    is_linear = limits.approach * left <= s and nx * nx + ny * ny + nz * nz <= max(s * s, calm)
    if is_linear or (margin < inf and left < NEAR):
        k1, k2, k3 = limits.share, limits.settle, min(limits.approach * left, sqrt(margin * left))
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
    go = saturated(
        alpha, velocity_command(goal, omega, alpha, alpha_target, limits, limits.settle), limits
    )

    f, jerk = (fx, fy, fz), limits.jerk
    angle, known = dot(f, e), dot(f, alpha_target)

    def excess(rate: float) -> float:
        stop = stopping_angle(along + 0.5 * h * rate, rate, most, jerk)
        return stop - angle + h * h * rate / 6.0

    fast = dot(f, go) - known
    over = excess(fast)
    if over <= 0.0:
        return go, False
    halt = saturated(
        alpha, velocity_command(omega_target, omega, alpha, alpha_target, limits, 1.0 / h), limits
    )
    slow = dot(f, halt) - known
    under = excess(slow)
    if under >= 0.0:
        return halt, False
    low, high = 0.0, 1.0
    for _ in range(5):
        share = low + (high - low) * under / (under - over)
        found = excess(slow + share * (fast - slow))
        if found > 0.0:
            high, over = share, found
        else:
            low, under = share, found
    return combine(halt, 1.0 - low, go, low), False
