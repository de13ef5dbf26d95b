"""The values that pass between the servo and a driver.

They hold plain Python floats; the servo process loads no NumPy.  They are named tuples, which take
a quarter of the time of frozen dataclasses to make.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import NamedTuple

from orientd.tolerances import NORM_TOLERANCE

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

MOST_JOINTS = 8
"""Most axes of a device."""

FUTURE_NS = 1_000_000_000
"""How far in the future a time stamp of another process or device may lie."""


class AxisLimits(NamedTuple):
    """Limits of one axis of a device.

    Attributes:
        name: name of the axis in messages.
        low: least angle, rad, unwrapped: whole turns count.
        high: largest angle, rad, unwrapped.
        velocity: rad/s.
        acceleration: rad/s^2; infinite if nothing limits it.
        jerk: rad/s^3; infinite if nothing limits it.
        resolution: least angle that the device can turn by, rad.  A path may pass the ends of the
            range by less than that; the driver then stays at the end.
    """

    name: str
    low: float
    high: float
    velocity: float
    acceleration: float = inf
    jerk: float = inf
    resolution: float = 1e-9


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


def feedback_problem(feedback: object, now_ns: int) -> str:
    """Return what is wrong with the *feedback* of a driver at *now_ns*, or an empty string.

    It checks types, lengths, that all numbers are finite, the norm of the quaternion and the time.
    """
    if not isinstance(feedback, Feedback):
        return f"expected a Feedback, got {feedback!r:.80}"
    time_ns, q, omega_body, position, joints = feedback
    if type(time_ns) is not int or not 0 <= time_ns <= now_ns + FUTURE_NS:
        return f"expected time_ns up to {now_ns} as an int, got {time_ns!r:.80}"
    for name, numbers, least, most in (
        ("q", q, 4, 4),
        ("omega_body", omega_body, 3, 3),
        ("position", position, 3, 3),
        ("joints", joints, 0, MOST_JOINTS),
    ):
        if not _are_numbers(numbers, least, most):
            count = f"{most}" if least else f"at most {most}"
            return f"expected {name} to be a tuple of {count} finite numbers, got {numbers!r:.80}"
    if not abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) <= 2 * NORM_TOLERANCE:
        return f"expected q to be a unit quaternion, got {q}"
    return ""


def _are_numbers(numbers: object, least: int, most: int) -> bool:
    """Return whether this is a tuple of *least* to *most* finite numbers."""
    try:
        return (
            isinstance(numbers, tuple)
            and least <= len(numbers) <= most
            and all(map(isfinite, numbers))
        )
    except (TypeError, OverflowError):
        return False


class AxisGap(NamedTuple):
    """Distance of one axis of a device from its last setpoint.

    Attributes:
        name: name of the axis in messages.
        gap: angle from the measured to the commanded angle, rad.
        tolerance: largest gap of an axis that has arrived, rad.
        load: load of the axis in words, for example ``0.45 A``; empty if unknown.
        patience: time after the last setpoint of a motion within which the axis must arrive, at its
            current speed; s.
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
