"""The values that pass between the servo and a driver.

They hold plain Python floats; the servo process loads no NumPy.  They are named tuples, which take
a quarter of the time of frozen dataclasses to make.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

Vector3 = tuple[float, float, float]
"""``(x, y, z)``; the name of the field has its frame and unit."""
Quaternion = tuple[float, float, float, float]
"""``(w, x, y, z)`` of norm 1, tool to world."""

Joints = tuple[float, ...]
"""Angles of a device's axes, rad, unwrapped: whole turns count."""

ZERO: Vector3 = (0.0, 0.0, 0.0)
"""Zero velocity, or the origin."""
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
"""The orientation of the world itself."""


class AxisLimits(NamedTuple):
    """Limits of one axis of a device.

    Attributes:
        name: name of the axis in messages.
        low: least angle, rad, unwrapped: whole turns count.
        high: largest angle, rad, unwrapped.
        velocity: rad/s.
        acceleration: rad/s^2; infinite if nothing limits it.
        jerk: rad/s^3; infinite if nothing limits it.
    """

    name: str
    low: float
    high: float
    velocity: float
    acceleration: float = inf
    jerk: float = inf


class Setpoint(NamedTuple):
    """The target of the device for the end of one cycle.

    Attributes:
        time_ns: the cycle's deadline on the monotonic clock.
        q: orientation ``(w, x, y, z)``, tool to world.
        omega_body: angular velocity, rad/s, body frame.
        alpha_body: its derivative in body components, rad/s^2.
        position: tool position in the world, m.
        velocity: its derivative, m/s.
        joints: angles of the axes, rad; empty unless the driver takes joints.
    """

    time_ns: int
    q: Quaternion
    omega_body: Vector3 = ZERO
    alpha_body: Vector3 = ZERO
    position: Vector3 = ZERO
    velocity: Vector3 = ZERO
    joints: Joints = ()


class Feedback(NamedTuple):
    """The measured state of the device.

    Attributes:
        time_ns: time of the *measurement*, on the monotonic clock; the servo computes the age.
        q: measured orientation ``(w, x, y, z)``, tool to world.
        omega_body: measured angular velocity, rad/s, body frame.
        position: measured tool position in the world, m.
        joints: measured angles of the axes, rad; empty if the device has none.
    """

    time_ns: int
    q: Quaternion
    omega_body: Vector3 = ZERO
    position: Vector3 = ZERO
    joints: tuple[float, ...] = ()


class AxisGap(NamedTuple):
    """Distance of one axis of a device from its last setpoint.

    Attributes:
        name: name of the axis in messages.
        gap: angle from the measured to the commanded angle, rad.
        tolerance: largest gap of an axis that has arrived, rad.
        load: load of the axis in words, for example ``0.45 A``; empty if unknown.
        patience: time after the last setpoint of a motion within which the axis must arrive, s.
    """

    name: str
    gap: float
    tolerance: float
    load: str = ""
    patience: float = 0.5


class PartHealth(NamedTuple):
    """Condition of one part of a device, such as a servo or a joint.

    Attributes:
        name: name of the part.
        time_ns: time of the measurement, monotonic clock.
        voltage: supply voltage, V; ``None`` if unknown.
        temperature: degrees Celsius; ``None`` if unknown.
        current: A, with the sign of the torque; ``None`` if unknown.
        warning: a problem that is developing, in words; empty if none.
    """

    name: str
    time_ns: int
    voltage: float | None = None
    temperature: float | None = None
    current: float | None = None
    warning: str = ""
