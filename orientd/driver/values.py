"""The values that pass between the servo and a driver.

No NumPy here: a cycle is plain Python floats, and the values are named tuples, which are made in a
quarter of the time of a frozen dataclass.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

Vector3 = tuple[float, float, float]
"""``(x, y, z)``; its frame and unit are in the name of what holds it."""
Quaternion = tuple[float, float, float, float]
"""``(w, x, y, z)`` of norm 1, tool to world."""

Joints = tuple[float, ...]
"""Angles of a device's axes, rad, unwrapped: whole turns count."""

ZERO: Vector3 = (0.0, 0.0, 0.0)
"""No velocity, or the origin."""
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
"""The orientation of the world itself."""


class AxisLimits(NamedTuple):
    """What one axis of a device may do.

    Attributes:
        name: of the axis, as messages name it.
        low: least angle, rad, unwrapped: whole turns count.
        high: largest angle, rad.
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
    """What the device is asked to do in one cycle.

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
    """What the device reported.

    Attributes:
        time_ns: when it was *measured*, on the monotonic clock; the servo computes the age.
        q: measured orientation ``(w, x, y, z)``, tool to world.
        omega_body: measured angular velocity, rad/s, body frame.
        position: measured tool position in the world, m.
        joints: whatever the device's axes are, rad; empty where it has none.
    """

    time_ns: int
    q: Quaternion
    omega_body: Vector3 = ZERO
    position: Vector3 = ZERO
    joints: tuple[float, ...] = ()


class AxisGap(NamedTuple):
    """How far one axis of a device is from where it was last sent.

    Attributes:
        name: of the axis, as messages name it.
        gap: angle from where it was measured to where it was sent, rad.
        tolerance: how large that may be where the axis has arrived, rad.
        load: what the axis draws or carries, in words, for example ``0.45 A``; empty where the
            device does not tell.
        patience: how long after the last setpoint of a motion the axis may take to arrive, s.
    """

    name: str
    gap: float
    tolerance: float
    load: str = ""
    patience: float = 0.5


class PartHealth(NamedTuple):
    """How one part of a device is: a servo, a joint.

    Attributes:
        name: of the part.
        time_ns: when it was measured, monotonic clock.
        voltage: of its supply, V; ``None`` where it is not told.
        temperature: degrees Celsius; ``None`` where it is not told.
        current: A, its sign that of the torque; ``None`` where it is not told.
        warning: what is soon to go wrong, in words; empty where nothing is.
    """

    name: str
    time_ns: int
    voltage: float | None = None
    temperature: float | None = None
    current: float | None = None
    warning: str = ""
