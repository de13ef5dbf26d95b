"""Backward differences of setpoints, as in :mod:`orientd.planner.certify.differences`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from reference.brake import limited_brake_rate

from orientd.planner.certify.differences import OFF_GRID, Extremes, Rough
from orientd.planner.limits import Limits
from orientd.planner.recorded import HISTORY
from orientd.rotation import Floats, conjugate, log, multiply


def differences(q: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the first three backward differences of orientations, in units of rad a period.

    Args:
        q: setpoints, shape ``(n, 4)``.

    Returns:
        The rotation vectors from one setpoint to the next, the change of these and the change of
        that, shapes ``(n - 1, 3)`` to ``(n - 3, 3)``.
    """
    omega = log(multiply(conjugate(q[:-1]), q[1:]))
    alpha = np.diff(omega, axis=0)
    return omega, alpha, np.diff(alpha, axis=0)


def extremes(
    q: Floats,
    *,
    past: int = 0,
    with_axes: bool = False,
    period: float = 1.0,
    start: float = 0.0,
    rough: Rough | None = None,
    brake_limits: Limits | None = None,
) -> Extremes:
    """Return what :func:`orientd.planner.certify.differences.extremes` does."""
    rates = omega, alpha, jerk = differences(q)
    with_axes = with_axes or (brake_limits is not None and brake_limits.has_axes)
    found = Extremes([[0.0] * 4 for _ in rates], [[0] * 4 for _ in rates])
    for order, first in enumerate((2 * past, past, 0)):
        squares = np.sum(rates[order] ** 2, axis=1)
        columns = [squares, *(rates[order].T ** 2 if with_axes else ())]
        for column, values in enumerate(columns):
            if len(values) > first:
                place = first + int(np.argmax(values[first:]))
                found.largest[order][column] = float(values[place])
                found.places[order][column] = place
    if brake_limits is None or not len(jerk):
        return found
    times = start + period * np.arange(len(jerk))
    bends, twists = np.ones((2, len(jerk)))
    if rough is not None:
        is_rough = (times >= rough.begin) & (times < rough.end + HISTORY * period)
        bends[is_rough], twists[is_rough] = OFF_GRID[rough.continuity]
    velocity = omega[2:] / period
    acceleration = bends[:, None] * alpha[1:] / period**2
    rate, place = limited_brake_rate(
        velocity, acceleration, twists[:, None] * jerk / period**3, brake_limits
    )
    return replace(found, rate=rate, rate_place=place)
