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
from orientd.driver.floats import difference, exp, multiply, norm, normalize
from orientd.stream import Terms

TOLERANCE = 1.001
"""How far above a limit a setpoint may be: rounding and the planner's grid, not a reserve."""

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
        self.anchor((1.0, 0.0, 0.0, 0.0), ZERO)

    def anchor(self, q: Quaternion, position: Vector3) -> None:
        """Begin at rest at *q* and *position*."""
        self.q, self.omega, self.alpha = q, ZERO, ZERO
        self.position, self.velocity = position, ZERO

    def admit(self, q: Quaternion, position: Vector3, terms: Terms) -> str:
        """Take a setpoint if it keeps *terms*.

        Returns:
            An empty string, or what it would have broken, by how much; then nothing was taken.
        """
        h = self.period
        x, y, z = difference(self.q, q)
        omega = (x / h, y / h, z / h)
        a, b, c = self.omega
        alpha = ((omega[0] - a) / h, (omega[1] - b) / h, (omega[2] - c) / h)
        a, b, c = self.alpha
        jerk = sqrt((alpha[0] - a) ** 2 + (alpha[1] - b) ** 2 + (alpha[2] - c) ** 2) / h
        rounding = _ROUNDING / h
        problem = (
            _excess("angular velocity", norm(omega), terms.velocity, rounding, "rad/s")
            or _excess(
                "angular acceleration", norm(alpha), terms.acceleration, rounding / h, "rad/s^2"
            )
            or _excess("angular jerk", jerk, terms.jerk, rounding / h / h, "rad/s^3")
        )
        p, v = self.position, self.velocity
        velocity = ((position[0] - p[0]) / h, (position[1] - p[1]) / h, (position[2] - p[2]) / h)
        if velocity != v:
            change = (velocity[0] - v[0], velocity[1] - v[1], velocity[2] - v[2])
            problem = (
                problem
                or _excess("velocity", norm(velocity), terms.linear_velocity, rounding, "m/s")
                or _excess(
                    "acceleration",
                    norm(change) / h,
                    terms.linear_acceleration,
                    rounding / h,
                    "m/s^2",
                )
            )
        if problem:
            return problem
        self.q, self.omega, self.alpha = q, omega, alpha
        self.position, self.velocity = position, velocity
        return ""

    def soft_stop(self, terms: Terms) -> Iterator[tuple[Quaternion, Vector3]]:
        """Yield setpoints that come to rest from what was last written, off the path if need be.

        First the acceleration falls to zero as fast as the jerk limit allows, then the velocity
        falls along ``1 - 3t^2 + 2t^3``, in the shortest whole number of cycles inside the limits.
        The guard's own state follows.
        """
        h = self.period
        ramp = ceil(norm(self.alpha) / (terms.jerk * h))
        alpha, omega = self.alpha, self.omega
        for k in range(1, ramp + 1):
            share = 1.0 - k / ramp
            omega = _plus(omega, alpha, share * h)
            yield self._step(omega, self.velocity)
        speed, velocity = norm(omega), self.velocity
        cycles = ceil(
            max(
                1.5 * speed / (terms.acceleration * h),
                sqrt(6.0 * speed / terms.jerk) / h,
                1.5 * norm(velocity) / (terms.linear_acceleration * h),
                1.0,
            )
        )
        for k in range(1, cycles + 1):
            t = k / cycles
            share = 1.0 - t * t * (3.0 - 2.0 * t)
            yield self._step(_plus(ZERO, omega, share), _plus(ZERO, velocity, share))
        self.omega = self.alpha = self.velocity = ZERO

    def _step(self, omega: Vector3, velocity: Vector3) -> tuple[Quaternion, Vector3]:
        h = self.period
        self.alpha = _plus(_plus(ZERO, omega, 1.0 / h), self.omega, -1.0 / h)
        self.q = normalize(multiply(self.q, exp(_plus(ZERO, omega, h))))
        self.position = _plus(self.position, velocity, h)
        self.omega, self.velocity = omega, velocity
        return self.q, self.position


def _plus(a: Vector3, b: Vector3, factor: float) -> Vector3:
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def _excess(quantity: str, reached: float, limit: float, rounding: float, unit: str) -> str:
    # Written so that a NaN counts as a violation.
    if reached <= limit * TOLERANCE + rounding:
        return ""
    return f"{quantity} {reached:.6g} {unit}, the limit is {limit:.6g} {unit}"
