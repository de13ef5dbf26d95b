r"""The rates of the time scaling that keep the limits in one cycle, as the guard sees it.

A rate :math:`\sigma` leads to a setpoint.  The velocity of the device in the next cycle is
:math:`\Omega(\sigma) = C + \omega \sigma`, where :math:`\omega` is the path's own velocity
and *C* comes from the bend of the path within a cycle.  With the velocity :math:`\Omega_p` and the
acceleration :math:`A_p` of the previous cycle, the guard's differences are

.. math::
    A = (\Omega(\sigma) - \Omega_p) / h, \qquad J = (A - A_p) / h .

Both are linear in :math:`\sigma`.  So a limit of a norm is a quadratic inequality, a limit of an
axis a linear one, and the rates that keep all of them form an interval.

The joints of the device are differentiated in the same way, one by one, and each has its own
limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import NamedTuple

from orientd import kernels
from orientd.driver import ZERO, AxisLimits, Joints, Vector3
from orientd.floats import plus
from orientd.stream.records import ServoLimits

_LEAST_RELEASE = 0.3
_STILL = 1e-9  # rad/s: where the path stands still by itself, its rate does not matter


class Past(NamedTuple):
    """The last motion of the device, by backward differences.

    Attributes:
        omega: angular velocity, rad/s.
        alpha: angular acceleration, rad/s^2.
        velocity: of the position, m/s.
        rate: of the time scaling.
        joint_rates: velocities of the axes, rad/s; empty if the path has no joints.
        joint_changes: their accelerations, rad/s^2.
    """

    omega: Vector3
    alpha: Vector3
    velocity: Vector3
    rate: float
    joint_rates: Joints = ()
    joint_changes: Joints = ()


class Ahead(NamedTuple):
    """The effect of a rate: ``bend + omega * rate``, and the same for position and axes.

    Attributes:
        omega: angular velocity of the path, rad/s.
        bend: the part not proportional to the rate, rad/s.
        velocity: of the path's position, m/s.
        shift: the part not proportional to the rate, m/s.
        joints: both terms of every axis, the one not proportional first, rad/s.
    """

    omega: Vector3
    bend: Vector3
    velocity: Vector3
    shift: Vector3
    joints: Sequence[tuple[float, float]] = ()


def allowed(
    past: Past,
    ahead: Ahead,
    servo_limits: ServoLimits,
    axes: Sequence[AxisLimits],
    period: float,
    share: float,
) -> tuple[float, float]:
    """Return the least and the largest rate within the limits; least > largest if there is none.

    A *share* of the limits of acceleration and of jerk may be used.
    """
    x, y, z = ahead.omega
    a, b, c = ahead.bend
    u, v, w = past.omega
    ax, ay, az = past.alpha
    # In units of velocity: the differences times the powers of the period.
    gx, gy, gz = a - u, b - v, c - w
    kx, ky, kz = gx - ax * period, gy - ay * period, gz - az * period
    most, most_jerk = share * period, share * period * period
    low, high = _ball(gx, gy, gz, x, y, z, most * servo_limits.acceleration)
    intervals = [_ball(kx, ky, kz, x, y, z, most_jerk * servo_limits.jerk)]
    if servo_limits.has_axes:
        for limits, factor, base in (
            (servo_limits.axis_acceleration, most, (gx, gy, gz)),
            (servo_limits.axis_jerk, most_jerk, (kx, ky, kz)),
        ):
            for limit, start, slope in zip(limits, base, (x, y, z), strict=True):
                intervals.append(_slab(start, slope, factor * limit))
    if ahead.velocity != ZERO:
        x, y, z = ahead.velocity
        a, b, c = plus(ahead.shift, past.velocity, -1.0)
        intervals.append(_ball(a, b, c, x, y, z, most * servo_limits.linear_acceleration))
    if ahead.joints:
        for axis, (rest, slope), rate, change in zip(
            axes, ahead.joints, past.joint_rates, past.joint_changes, strict=True
        ):
            start = rest - rate
            intervals.append(_slab(start, slope, most * axis.acceleration))
            if axis.jerk < inf:
                intervals.append(_slab(start - change * period, slope, most_jerk * axis.jerk))
    for least, largest in intervals:
        low, high = max(low, least), min(high, largest)
    return low, high


def released(
    past: Past,
    ahead: Ahead,
    servo_limits: ServoLimits,
    axes: Sequence[AxisLimits],
    period: float,
    share: float,
) -> float:
    """Return the least rate from which speed and acceleration can still reach zero together.

    The speed falls by a first change and then by less in each cycle, as fast as the jerk along the
    path allows.

    Args:
        past: the previous cycle.
        ahead: the effect of a rate.
        servo_limits: the limits.
        axes: limits of the device's axes.
        period: between the two, s.
        share: usable share of the jerk for the final phase.
    """
    x, y, z = ahead.omega
    a, b, c = ahead.bend
    path_speed = sqrt(x * x + y * y + z * z)
    u, v, w = past.omega
    speed = sqrt(u * u + v * v + w * w)
    if path_speed < _STILL:
        return 0.0
    x, y, z = x / path_speed, y / path_speed, z / path_speed
    jerk = servo_limits.jerk
    # The bend of the path needs its share of the jerk as well.
    ax, ay, az = past.alpha
    along = ax * x + ay * y + az * z
    turn = 3.0 * sqrt(max(ax * ax + ay * ay + az * az - along * along, 0.0)) * along
    across = min(abs(turn) / speed, jerk) if speed > _STILL else 0.0
    jerk = max(sqrt(jerk * jerk - across * across), _LEAST_RELEASE * jerk)
    if servo_limits.has_axes:
        for limit, part in zip(servo_limits.axis_jerk, (x, y, z), strict=True):
            if part != 0.0:
                jerk = min(jerk, limit / abs(part))
    for axis, (_, slope) in zip(axes, ahead.joints, strict=False):
        if axis.jerk < inf and slope != 0.0:
            jerk = min(jerk, axis.jerk * path_speed / abs(slope))
    step = share * jerk * period * period
    return (speed - kernels.first_change(speed, step) - (a * x + b * y + c * z)) / path_speed


def nearest(
    past: Past,
    ahead: Ahead,
    servo_limits: ServoLimits,
    axes: Sequence[AxisLimits],
    period: float,
    share: float,
    wanted: float,
) -> float | None:
    """Return the feasible rate in [0, 1] nearest to the wanted one, or ``None``.

    If no rate keeps the share of the limits, the full limits apply.
    """
    for part in (share, 1.0):
        low, high = allowed(past, ahead, servo_limits, axes, period, part)
        low, high = max(low, 0.0), min(high, 1.0)
        if low <= high:
            return min(max(wanted, low), high)
    return None


def _ball(
    a: float, b: float, c: float, x: float, y: float, z: float, limit: float
) -> tuple[float, float]:
    """Return the interval of t where ``|(a, b, c) + t (x, y, z)| <= limit``."""
    square = x * x + y * y + z * z
    constant = a * a + b * b + c * c - limit * limit
    if square <= _STILL * _STILL:
        return (-inf, inf) if constant <= 0.0 else (inf, -inf)
    half = a * x + b * y + c * z
    root = half * half - square * constant
    if not root >= 0.0:
        return inf, -inf
    root = sqrt(root)
    return (-half - root) / square, (root - half) / square


def _slab(start: float, slope: float, limit: float) -> tuple[float, float]:
    """Return the interval of t where ``|start + t slope| <= limit``."""
    if abs(slope) <= _STILL:
        return (-inf, inf) if abs(start) <= limit else (inf, -inf)
    one, other = (-limit - start) / slope, (limit - start) / slope
    return (one, other) if one <= other else (other, one)
