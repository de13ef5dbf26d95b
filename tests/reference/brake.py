"""The largest safe brake rate in plain NumPy; :mod:`orientd.planner.certify.brake` derives it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.model.limits import Limits
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.rotation import Floats

_SIGMA, _G = LAW[0][:, :, None]
_MARGIN = float(LAW[-1][-1])


def brake_rate(
    velocity: Floats, acceleration: Floats, jerk: Floats, most: float, most_jerk: float
) -> tuple[float, int]:
    """Return what :func:`orientd.planner.certify.brake.brake_rate` does, looking at every point."""
    speed, size = np.linalg.norm(velocity, axis=1), np.linalg.norm(acceleration, axis=1)
    along = np.abs(np.sum(velocity * acceleration, axis=1))
    return _least(np.stack([speed, size, along, jerk]), most, most_jerk)


def least_brake_rate(columns: Sequence[Floats], limits: Limits) -> tuple[float, int]:
    """Return the largest brake rate that keeps the limits of the norms and of the axes.

    Args:
        columns: of the norm, then of each axis that is limited: sizes of velocity, acceleration,
            their product and jerk of the points of a path, shape ``(4, n)``.
        limits: what the device may see.
    """
    most = [limits.acceleration, *limits.axis_acceleration]
    most_jerk = [limits.jerk, *limits.axis_jerk]
    found = [_least(rows, *each) for rows, *each in zip(columns, most, most_jerk, strict=False)]
    return min(found, key=lambda each: each[0])


def _least(rows: Floats, most: float, most_jerk: float) -> tuple[float, int]:
    speed, size, along, jerk = rows
    if not len(jerk):
        return FASTEST_BRAKE_RATE, 0
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


def _root(rest: Floats, half: Floats, leading: Floats) -> Floats:
    rest = np.maximum(rest, 0.0)
    divisor = half + np.sqrt(half * half + leading * rest)
    roots = np.divide(rest, divisor, out=np.full(divisor.shape, np.inf), where=divisor > 0.0)
    least: Floats = roots.min(axis=0)
    return least
