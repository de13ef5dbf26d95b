"""The guard: the last check of a setpoint before the servo writes it.

It differentiates backwards, as a device does.  The velocity is the rotation vector from the
previous setpoint to this one over the period.  The acceleration is the change of the velocity, and
the jerk is the change of the acceleration.  The joints of the device, if a path has them, are
differentiated in the same way.  The servo does not write a setpoint that breaks a limit, or that
leads into a keep-out cone.  It stops from the last one that it *has* written.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from orientd.driver import ZERO, AxisLimits, Joints, Quaternion, Vector3
from orientd.floats import combine, difference, norm, plus
from orientd.servo.keep_out_cones import KeepOutCones, Room
from orientd.stream.records import ServoLimits
from orientd.tolerances import GUARD_TOLERANCE

_ROUNDING = 4e-15
"""Rounding of a difference of two orientations, rad; it is divided by powers of the period."""

_JOINT_ROUNDING = 1e-12
"""Rounding of a difference of two axis angles, which may be hundreds of turns."""

_QUANTITIES = (
    ("angular velocity", "rad/s"),
    ("angular acceleration", "rad/s^2"),
    ("angular jerk", "rad/s^3"),
)


class Guard:
    """Backward differences of the written setpoints, and the limits that they must keep.

    Attributes:
        q: last written orientation.
        omega: angular velocity of the last step, rad/s.
        alpha: angular acceleration of the last two steps, rad/s^2.
        position: last written position, m.
        velocity: its velocity over the last step, m/s.
        acceleration: its acceleration over the last two steps, m/s^2.
        axes: limits of the device's axes; empty if unknown.
        joints: last written angles of the axes, rad; empty if the setpoint had none.
        joint_rates: their velocities over the last step, rad/s; empty if unknown.
        joint_changes: their accelerations over the last two steps, rad/s^2; empty if unknown.
    """

    def __init__(self, period: float, cones: KeepOutCones | None = None) -> None:
        """Expect setpoints *period* seconds apart, outside of *cones*."""
        self.period = period
        self._cones = cones
        self._room = None if cones is None else Room(cones)
        self.axes: tuple[AxisLimits, ...] = ()
        self._most_joints: list[tuple[float, float, float]] = []
        self._servo_limits: ServoLimits | None = None
        self._most = (0.0, 0.0, 0.0)
        self.anchor((1.0, 0.0, 0.0, 0.0), ZERO)

    def know(self, axes: Sequence[AxisLimits]) -> None:
        """Check joints against the limits of *axes* from here on."""
        self.axes = tuple(axes)
        unit, h = _JOINT_ROUNDING / self.period, self.period
        self._most_joints = [
            (
                axis.velocity * GUARD_TOLERANCE + unit,
                axis.acceleration * GUARD_TOLERANCE + unit / h,
                axis.jerk * GUARD_TOLERANCE + unit / h / h,
            )
            for axis in axes
        ]

    def anchor(self, q: Quaternion, position: Vector3, joints: Joints = ()) -> None:
        """Begin at rest at *q*, *position* and *joints*."""
        self.q, self.omega, self.alpha = q, ZERO, ZERO
        self.position, self.velocity, self.acceleration = position, ZERO, ZERO
        self.joints = joints
        self.joint_rates = self.joint_changes = (0.0,) * len(joints)
        if self._room is not None:
            self._room.forget()

    @property
    def is_at_rest(self) -> bool:
        """Whether all differences of the last written setpoints are zero."""
        return self.omega == self.alpha == self.velocity == ZERO

    def hold(self) -> None:
        """Accept the same setpoint once more, which no limit forbids."""
        x, y, z = self.omega
        if x or y or z or self.alpha != ZERO:
            h = self.period
            self.alpha, self.omega = (-x / h, -y / h, -z / h), ZERO
        if self.velocity != ZERO or self.acceleration != ZERO:
            self.acceleration = plus(ZERO, self.velocity, -1.0 / self.period)
            self.velocity = ZERO
        if any(self.joint_rates) or any(self.joint_changes):
            self.joint_rates, self.joint_changes = self._joint_steps(self.joints)

    def take(self, q: Quaternion, position: Vector3, joints: Joints = ()) -> None:
        """Accept a setpoint of a stop off the path, which keeps the limits as well as it can."""
        omega, velocity = self.rates(q, position)
        self.alpha = combine(omega, 1.0 / self.period, self.omega, -1.0 / self.period)
        self.acceleration = combine(velocity, 1.0 / self.period, self.velocity, -1.0 / self.period)
        self.q, self.omega, self.position, self.velocity = q, omega, position, velocity
        if self._room is not None:
            self._room.forget()
        self.joint_rates, self.joint_changes = self._joint_steps(joints)
        self.joints = joints

    def admit(
        self, q: Quaternion, position: Vector3, servo_limits: ServoLimits, joints: Joints = ()
    ) -> str:
        """Accept a setpoint if it keeps *servo_limits* and cones, and its joints those of the axes.

        Returns:
            An empty string, or the broken limit and the excess; the setpoint is then not accepted.
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
            return _beyond_norms((omega, alpha, (x, y, z)), servo_limits)
        if servo_limits.has_axes:
            problem = _beyond_components((omega, alpha, (x, y, z)), servo_limits, h)
            if problem:
                return problem
        if self._room is not None and self._cones is not None:
            self._room.shrink(sqrt(a * a + b * b + c * c) * h)
            if self._room.is_within(q, 0.0):
                problem = self._cones.intrusion(self.q, q)
                if problem:
                    return problem
        rates: Joints = ()
        changes: Joints = ()
        if joints:
            rates, changes = self._joint_steps(joints)
            problem = self._beyond_axes(rates, changes)
            if problem:
                return problem
        if position != self.position or self.velocity != ZERO or self.acceleration != ZERO:
            problem = self._admit_position(position, servo_limits)
            if problem:
                return problem
        self.q, self.omega, self.alpha = q, omega, alpha
        self.joints, self.joint_rates, self.joint_changes = joints, rates, changes
        return ""

    def _joint_steps(self, joints: Joints) -> tuple[Joints, Joints]:
        """Return velocities and accelerations of the axes, as far as previous joints are known."""
        if len(joints) != len(self.joints):
            return (), ()
        h = self.period
        rates = tuple([(a - b) / h for a, b in zip(joints, self.joints, strict=True)])
        if not self.joint_rates:
            return rates, ()
        return rates, tuple([(a - b) / h for a, b in zip(rates, self.joint_rates, strict=True)])

    def _beyond_axes(self, rates: Joints, changes: Joints) -> str:
        """Return which axis is too fast, or accelerates too much, or an empty string."""
        h = self.period
        before = self.joint_changes or changes
        for place, (fastest, hardest, sharpest) in enumerate(self._most_joints if rates else ()):
            rate = rates[place]
            change = changes[place] if changes else 0.0
            twist = (change - before[place]) / h if changes else 0.0
            # Written so that a NaN counts as a violation.
            if not (
                -fastest <= rate <= fastest
                and -hardest <= change <= hardest
                and -sharpest <= twist <= sharpest
            ):
                axis = self.axes[place]
                name = f" of {axis.name}"
                return (
                    _beyond("velocity", "rad/s", abs(rate), axis.velocity, axis=name)
                    or _beyond("acceleration", "rad/s^2", abs(change), axis.acceleration, axis=name)
                    or _beyond("jerk", "rad/s^3", abs(twist), axis.jerk, axis=name)
                    or f"a limit of {axis.name} by the rounding of its differences"
                )
        return ""

    def _expect(self, servo_limits: ServoLimits) -> None:
        """Store the squares of the allowed norms of *servo_limits*."""
        h, rounding = self.period, _ROUNDING / self.period
        self._servo_limits = servo_limits
        velocity = servo_limits.velocity * GUARD_TOLERANCE + rounding
        acceleration = servo_limits.acceleration * GUARD_TOLERANCE + rounding / h
        jerk = servo_limits.jerk * GUARD_TOLERANCE + rounding / h / h
        # Products, not powers, which overflow with an exception.
        self._most = (velocity * velocity, acceleration * acceleration, jerk * jerk)

    def _admit_position(self, position: Vector3, servo_limits: ServoLimits) -> str:
        h, rounding = self.period, _ROUNDING / self.period
        velocity = combine(position, 1.0 / h, self.position, -1.0 / h)
        acceleration = combine(velocity, 1.0 / h, self.velocity, -1.0 / h)
        problem = _beyond(
            "velocity", "m/s", norm(velocity), servo_limits.linear_velocity, rounding
        ) or _beyond(
            "acceleration",
            "m/s^2",
            norm(acceleration),
            servo_limits.linear_acceleration,
            rounding / h,
        )
        if not problem:
            self.position, self.velocity, self.acceleration = position, velocity, acceleration
        return problem

    def rates(self, q: Quaternion, position: Vector3) -> tuple[Vector3, Vector3]:
        """Return angular velocity and velocity, rad/s and m/s, of a step to a pose."""
        h, (x, y, z) = self.period, difference(self.q, q)
        return (x / h, y / h, z / h), combine(position, 1.0 / h, self.position, -1.0 / h)

    def braked_position(self, servo_limits: ServoLimits) -> Vector3:
        """Return the next position on the fastest stop along a straight line."""
        speed, brake = norm(self.velocity), servo_limits.linear_acceleration * self.period
        share = 1.0 - brake / speed if speed > brake else 0.0
        return plus(self.position, self.velocity, share * self.period)


def _beyond(
    name: str, unit: str, size: float, limit: float, slack: float = 0.0, axis: str = ""
) -> str:
    """Return a message if a quantity exceeds its limit or is NaN."""
    if size <= limit * GUARD_TOLERANCE + slack:
        return ""
    return f"{name} {size:.6g} {unit}{axis}, the limit is {limit:.6g} {unit}"


def _beyond_norms(rates: tuple[Vector3, Vector3, Vector3], servo_limits: ServoLimits) -> str:
    """Return which norm is too large: the lowest derivative, whose excess causes the others."""
    limits = servo_limits.velocity, servo_limits.acceleration, servo_limits.jerk
    for names, vector, limit in zip(_QUANTITIES, rates, limits, strict=True):
        problem = _beyond(*names, norm(vector), limit)
        if problem:
            return problem
    return "a limit by the rounding of its differences"


def _beyond_components(
    rates: tuple[Vector3, Vector3, Vector3], servo_limits: ServoLimits, h: float
) -> str:
    """Return which component is too large, lowest derivative first."""
    slack = _ROUNDING / h
    axes = servo_limits.axis_velocity, servo_limits.axis_acceleration, servo_limits.axis_jerk
    for names, (x, y, z), (a, b, c) in zip(_QUANTITIES, rates, axes, strict=True):
        if not (
            abs(x) <= a * GUARD_TOLERANCE + slack
            and abs(y) <= b * GUARD_TOLERANCE + slack
            and abs(z) <= c * GUARD_TOLERANCE + slack
        ):
            parts = (abs(x), a, "x"), (abs(y), b, "y"), (abs(z), c, "z")
            size, limit, axis = max(parts, key=lambda part: part[0] / part[1])
            return _beyond(*names, size, limit, slack, f" about {axis}")
        slack /= h
    return ""
