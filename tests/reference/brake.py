"""The largest safe brake rate in plain NumPy; :mod:`orientd.planner.certify.brake` derives it."""

from __future__ import annotations

import numpy as np

from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.planner.limits import Limits
from orientd.rotation import Floats

_SIGMA, _G = LAW[0][:, :, None]
_MARGIN = LAW[-1]


def brake_rate(
    velocity: Floats, acceleration: Floats, jerk: Floats, most: float, most_jerk: float
) -> tuple[float, int]:
    """Return what :func:`orientd.planner.certify.brake.brake_rate` does, looking at every point."""
    if not len(jerk):
        return FASTEST_BRAKE_RATE, 0
    speed, size = np.linalg.norm(velocity, axis=1), np.linalg.norm(acceleration, axis=1)
    along = np.abs(np.sum(velocity * acceleration, axis=1))
    rates = np.full(speed.shape, FASTEST_BRAKE_RATE / _MARGIN)
    square = _SIGMA**2
    # P x^2 + 2 H x <= R: the root in the form that does not cancel.
    if np.isfinite(most):
        rest = most * most - (size * square) ** 2
        rates = np.minimum(rates, _root(rest, _G * square * along, (_G * speed) ** 2))
    if np.isfinite(most_jerk):
        rest = most_jerk - jerk * square
        rates = np.minimum(rates, _root(rest, 1.5 * _SIGMA * _G * size, 4.0 * speed))
    safe = np.where((size > most) | (jerk > most_jerk), 0.0, _MARGIN * rates)
    index = int(np.argmin(safe))
    return (
        (float(safe[index]), index) if safe[index] < FASTEST_BRAKE_RATE else (FASTEST_BRAKE_RATE, 0)
    )


def limited_brake_rate(
    omega: Floats, alpha: Floats, jerk: Floats, limits: Limits
) -> tuple[float, int]:
    """Return the largest brake rate that keeps the limits of the norms and of the axes.

    Args:
        omega: angular velocities of the path, rad/s, shape ``(n, 3)``.
        alpha: angular accelerations, rad/s^2, shape ``(n, 3)``.
        jerk: angular jerks, rad/s^3, shape ``(n, 3)``.
        limits: what the device may see.
    """
    sizes = np.linalg.norm(jerk, axis=1)
    found = [brake_rate(omega, alpha, sizes, limits.acceleration, limits.jerk)]
    for axis in range(3 if limits.has_axes else 0):
        one = slice(axis, axis + 1)
        most, most_jerk = limits.axis_acceleration[axis], limits.axis_jerk[axis]
        size = np.abs(jerk[:, axis])
        found.append(brake_rate(omega[:, one], alpha[:, one], size, most, most_jerk))
    return min(found, key=lambda each: each[0])


def _root(rest: Floats, half: Floats, leading: Floats) -> Floats:
    rest = np.maximum(rest, 0.0)
    divisor = half + np.sqrt(half * half + leading * rest)
    roots = np.divide(rest, divisor, out=np.full(divisor.shape, np.inf), where=divisor > 0.0)
    least: Floats = roots.min(axis=0)
    return least
