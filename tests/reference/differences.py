"""Backward differences of setpoints, as in :mod:`orientd.planner.certify.differences`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from reference.brake import least_brake_rate
from reference.drawn import drawn

from orientd.planner.certify.differences import Extremes
from orientd.planner.limits import Limits
from orientd.rotation import Floats, conjugate, log, multiply

PHASES = (0.5 - 0.125**0.5, 0.5, 0.5 + 0.125**0.5)
"""Shares of a period between two records at which differences are looked at."""


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
    brake_limits: Limits | None = None,
) -> Extremes:
    """Return what :func:`orientd.planner.certify.differences.extremes` does, all of it sampled."""
    with_axes = with_axes or (brake_limits is not None and brake_limits.has_axes)
    known = int(np.sum(np.isnan(q[:3, 4]))) if q.shape[1] == 10 else 0
    phases = [differences(q[:, :4])]
    for share in PHASES if q.shape[1] == 10 else ():
        between = differences(drawn(q[known:], period, share))
        empty = np.full((known, 3), np.nan)
        phases.append(tuple(np.concatenate([empty, part]) for part in between))
    found = Extremes([[0.0] * 4 for _ in range(6)], [[0] * 4 for _ in range(3)])
    for order, first in enumerate((2 * past, past, 0)):
        for column in range(4 if with_axes else 1):
            squares = [_squares(rates[order], column)[first:] for rates in phases]
            if len(squares[0]):
                tops = [float(np.max(part, initial=-1.0)) for part in squares]
                phase = int(np.argmax([-1.0 if np.isnan(top) else top for top in tops]))
                found.largest[order][column] = max(tops)
                found.largest[3 + order][column] = tops[0]
                found.places[order][column] = first + int(np.argmax(squares[phase]))
    if brake_limits is None or not len(phases[0][2]):
        return found
    rate, place = _slowest(phases, period, brake_limits)
    return replace(found, rate=rate, rate_place=place)


def _squares(vectors: Floats, column: int) -> Floats:
    squares: Floats = vectors[:, column - 1] ** 2 if column else np.sum(vectors**2, axis=1)
    return squares


def _slowest(
    phases: list[tuple[Floats, Floats, Floats]],
    period: float,
    limits: Limits,
) -> tuple[float, int]:
    """Return the least brake rate at and after every record, and which third difference sets it."""
    count = len(phases[0][2])
    columns = []
    for column in range(4 if limits.has_axes else 1):
        rows = np.zeros((4, count))
        for omega, alpha, jerk in phases:
            parts = [
                part[..., column - 1 : column] if column else part for part in (omega, alpha, jerk)
            ]
            v, a, j = parts[0][2:], parts[1][1:], parts[2]
            found = [
                np.linalg.norm(v, axis=1) / period,
                np.linalg.norm(a, axis=1) / period**2,
                np.abs(np.sum(v * a, axis=1)) / period**3,
                np.linalg.norm(j, axis=1) / period**3,
            ]
            rows[:, : len(j)] = np.fmax(rows[:, : len(j)], found)
        columns.append(rows)
    return least_brake_rate(columns, limits)
