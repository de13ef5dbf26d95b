"""The guard: the last look at a setpoint before it is written.

It differentiates backwards, as a device does: the rotation vector from the previous setpoint to
this one over the period is the velocity, the change of that the acceleration, the change of that
the jerk.  A setpoint that breaks a limit is not written; :meth:`Guard.soft_stop` then brings the
device to rest from what *was* written, inside the limits, wherever that leaves it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, sqrt

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, norm, normalize, plus
from orientd.servo.motion_law import halt, loosened, with_gains
from orientd.stream import ServoLimits
from orientd.tolerances import GUARD_TOLERANCE

_ROUNDING = 4e-15
"""Rounding of a difference of two orientations, rad; it is divided by the period's powers."""


class Guard:
    """Backward differences of what was written, and the limits they must keep.

    Attributes:
        q: orientation last written.
        omega: angular velocity of the last step, rad/s.
        alpha: angular acceleration of the last two steps, rad/s^2.
        position: position last written, m.
        velocity: its velocity over the last step, m/s.
    """

    def __init__(self, period: float) -> None:
        """Expect setpoints *period* seconds apart."""
        self.period = period
        self._servo_limits: ServoLimits | None = None
        self._most = (0.0, 0.0, 0.0)
        self.anchor((1.0, 0.0, 0.0, 0.0), ZERO)

    def anchor(self, q: Quaternion, position: Vector3) -> None:
        """Begin at rest at *q* and *position*."""
        self.q, self.omega, self.alpha = q, ZERO, ZERO
        self.position, self.velocity = position, ZERO

    @property
    def is_at_rest(self) -> bool:
        """Whether no difference of what was written last says that anything moves."""
        return self.omega == self.alpha == self.velocity == ZERO

    def hold(self) -> None:
        """Take the same setpoint once more, which no limit forbids."""
        x, y, z = self.omega
        if x or y or z or self.alpha != ZERO:
            h = self.period
            self.alpha, self.omega = (-x / h, -y / h, -z / h), ZERO
        self.velocity = ZERO

    def admit(self, q: Quaternion, position: Vector3, servo_limits: ServoLimits) -> str:
        """Take a setpoint if it keeps *servo_limits*.

        Returns:
            An empty string, or what it would have broken, by how much; then nothing was taken.
        """
        h = self.period
        if servo_limits is not self._servo_limits:
            self._expect(servo_limits)
        x, y, z = difference(self.q, q)
        omega = a, b, c = x / h, y / h, z / h
        x, y, z = self.omega
        alpha = u, v, w = (a - x) / h, (b - y) / h, (c - z) / h
        x, y, z = self.alpha
        x, y, z = (u - x) / h, (v - y) / h, (w - z) / h
        velocity, acceleration, jerk = self._most
        # Written so that a NaN counts as a violation.
        if not (
            a * a + b * b + c * c <= velocity
            and u * u + v * v + w * w <= acceleration
            and x * x + y * y + z * z <= jerk
        ):
            return _explain((norm(omega), norm(alpha), norm((x, y, z))), servo_limits)
        if servo_limits.has_axes:
            problem = _beyond_axes(omega, alpha, (x, y, z), servo_limits, h)
            if problem:
                return problem
        if position != self.position or self.velocity != ZERO:
            problem = self._admit_position(position, servo_limits)
            if problem:
                return problem
        self.q, self.omega, self.alpha = q, omega, alpha
        return ""

    def _expect(self, servo_limits: ServoLimits) -> None:
        """Keep the squares of what *servo_limits* allow the norms to be."""
        h, rounding = self.period, _ROUNDING / self.period
        self._servo_limits = servo_limits
        velocity = servo_limits.velocity * GUARD_TOLERANCE + rounding
        acceleration = servo_limits.acceleration * GUARD_TOLERANCE + rounding / h
        jerk = servo_limits.jerk * GUARD_TOLERANCE + rounding / h / h
        # Products, not powers, which overflow with an exception.
        self._most = (velocity * velocity, acceleration * acceleration, jerk * jerk)

    def _admit_position(self, position: Vector3, servo_limits: ServoLimits) -> str:
        h, rounding = self.period, _ROUNDING / self.period
        velocity = plus(plus(ZERO, position, 1.0 / h), self.position, -1.0 / h)
        speed, change = norm(velocity), norm(plus(velocity, self.velocity, -1.0)) / h
        problem = _beyond("velocity", speed, servo_limits.linear_velocity, "m/s", rounding)
        problem = problem or _beyond(
            "acceleration", change, servo_limits.linear_acceleration, "m/s^2", rounding / h
        )
        if not problem:
            self.position, self.velocity = position, velocity
        return problem

    def rates(self, q: Quaternion, position: Vector3) -> tuple[Vector3, Vector3]:
        """Return angular velocity and velocity, rad/s and m/s, of a step to there."""
        h, (x, y, z) = self.period, difference(self.q, q)
        velocity = plus(plus(ZERO, position, 1.0 / h), self.position, -1.0 / h)
        return (x / h, y / h, z / h), velocity

    def soft_stop(self, servo_limits: ServoLimits) -> Iterator[tuple[Quaternion, Vector3]]:
        """Yield setpoints that come to rest from what was last written, off the path if need be.

        As quickly as the norms allow; where components are limited by themselves, along a profile
        that is longer and keeps both.  The guard's own state follows.
        """
        if servo_limits.has_axes:
            yield from self._profiled_stop(servo_limits)
            return
        limits = with_gains(
            self.period, servo_limits.velocity, servo_limits.acceleration, servo_limits.jerk
        )
        while not self.is_at_rest:
            omega, _ = halt(self.omega, self.alpha, loosened(limits, self.omega, self.alpha))
            yield self._step(omega, self._braked(servo_limits))

    def braked_position(self, servo_limits: ServoLimits) -> Vector3:
        """Return the next position on the quickest way to rest along a straight line."""
        return plus(self.position, self._braked(servo_limits), self.period)

    def _braked(self, servo_limits: ServoLimits) -> Vector3:
        """Return the velocity of the next step of that."""
        speed, brake = norm(self.velocity), servo_limits.linear_acceleration * self.period
        return plus(ZERO, self.velocity, 1.0 - brake / speed) if speed > brake else ZERO

    def _profiled_stop(self, servo_limits: ServoLimits) -> Iterator[tuple[Quaternion, Vector3]]:
        """Yield setpoints that first take the acceleration away, then the velocity.

        The acceleration falls as fast as the jerk limit allows, the velocity along
        ``1 - 3t^2 + 2t^3`` in the shortest whole number of cycles inside the limits.
        """
        h = self.period
        ramp = ceil(_share(self.alpha, servo_limits.jerk, servo_limits.axis_jerk) / h)
        alpha, omega = self.alpha, self.omega
        for k in range(1, ramp + 1):
            share = 1.0 - k / ramp
            omega = plus(omega, alpha, share * h)
            yield self._step(omega, self.velocity)
        velocity = self.velocity
        cycles = ceil(
            max(
                1.5 * _share(omega, servo_limits.acceleration, servo_limits.axis_acceleration) / h,
                sqrt(6.0 * _share(omega, servo_limits.jerk, servo_limits.axis_jerk)) / h,
                1.5 * norm(velocity) / (servo_limits.linear_acceleration * h),
                1.0,
            )
        )
        for k in range(1, cycles + 1):
            t = k / cycles
            share = 1.0 - t * t * (3.0 - 2.0 * t)
            yield self._step(plus(ZERO, omega, share), plus(ZERO, velocity, share))
        self.omega = self.alpha = self.velocity = ZERO

    def _step(self, omega: Vector3, velocity: Vector3) -> tuple[Quaternion, Vector3]:
        h = self.period
        self.alpha = plus(plus(ZERO, omega, 1.0 / h), self.omega, -1.0 / h)
        self.q = normalize(multiply(self.q, exp(plus(ZERO, omega, h))))
        self.position = plus(self.position, velocity, h)
        self.omega, self.velocity = omega, velocity
        return self.q, self.position


def _share(vector: Vector3, limit: float, axes: Vector3) -> float:
    """Return how long a limited rate needs for a change by *vector* along itself, s."""
    x, y, z = vector
    return max(norm(vector) / limit, abs(x) / axes[0], abs(y) / axes[1], abs(z) / axes[2])


def _beyond(
    name: str, size: float, limit: float, unit: str, slack: float = 0.0, axis: str = ""
) -> str:
    """Say that a quantity is beyond its limit, if it is; no number is beyond it, too."""
    if size <= limit * GUARD_TOLERANCE + slack:
        return ""
    return f"{name} {size:.6g} {unit}{axis}, the limit is {limit:.6g} {unit}"


def _beyond_axes(
    omega: Vector3, alpha: Vector3, jerk: Vector3, servo_limits: ServoLimits, h: float
) -> str:
    """Return which component is too large, the lowest derivative first, or an empty string."""
    slack = _ROUNDING / h
    for name, vector, limits, unit in (
        ("angular velocity", omega, servo_limits.axis_velocity, "rad/s"),
        ("angular acceleration", alpha, servo_limits.axis_acceleration, "rad/s^2"),
        ("angular jerk", jerk, servo_limits.axis_jerk, "rad/s^3"),
    ):
        x, y, z = vector
        a, b, c = limits
        if not (
            abs(x) <= a * GUARD_TOLERANCE + slack
            and abs(y) <= b * GUARD_TOLERANCE + slack
            and abs(z) <= c * GUARD_TOLERANCE + slack
        ):
            parts = zip(map(abs, vector), limits, "xyz", strict=True)
            size, limit, axis = max(parts, key=lambda part: part[0] / part[1])
            return _beyond(name, size, limit, unit, slack, f" about {axis}")
        slack /= h
    return ""


def _explain(reached: tuple[float, float, float], servo_limits: ServoLimits) -> str:
    """Say which quantity is too large: the lowest derivative, whose excess causes the others."""
    velocity, acceleration, jerk = reached
    return (
        _beyond("angular velocity", velocity, servo_limits.velocity, "rad/s")
        or _beyond("angular acceleration", acceleration, servo_limits.acceleration, "rad/s^2")
        or _beyond("angular jerk", jerk, servo_limits.jerk, "rad/s^3")
        or "a limit by the rounding of its differences"
    )
