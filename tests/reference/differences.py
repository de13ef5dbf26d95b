"""Backward differences of setpoints, as in :mod:`orientd.planner.certify.measuring`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from reference.brake import least_brake_rate
from reference.drawn import drawn

from orientd import kernels
from orientd.model.limits import Limits
from orientd.planner import HISTORY
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.planner.certify.measuring import limit_table
from orientd.rotation import Floats, conjugate, log, multiply

PHASES = (0.5 - 0.125**0.5, 0.5, 0.5 + 0.125**0.5)
"""Shares of a period between two records at which differences are looked at."""


@dataclass(frozen=True)
class Extremes:
    """What a certificate takes of some setpoints.

    Attributes:
        largest: squares of bounds of the backward differences, in units of rad a period: of the
            norm and of the components, shape ``(6, 4)``; the last three rows are the largest ones
            on the records alone.
        places: which differences these are about, shape ``(3, 4)``.
        rate: the least brake rate, 1/s.
        rate_place: which third difference sets it.
        unproven: places without a proof.
    """

    largest: list[list[float]]
    places: list[list[int]]
    rate: float = FASTEST_BRAKE_RATE
    rate_place: int = 0
    unproven: int = 0


def certified(
    q: Floats,
    *,
    past: int = 0,
    with_axes: bool = False,
    period: float = 1.0,
    brake_limits: Limits | None = None,
) -> Extremes:
    """Return what the kernel finds, as :func:`extremes` does.

    Args:
        q: orientations, shape ``(n, 4)``; or with rates, shape ``(n, 10)``, where the path between
            the records is to count, too.
        past: 1 where the first three setpoints are those before the records.
        with_axes: whether the components are wanted.
        period: s.
        brake_limits: for a certificate.
    """
    rows = np.zeros((len(q), 13))
    rows[:, 4:10] = np.nan
    rows[:, : q.shape[1]] = q
    known = HISTORY * past
    if brake_limits is None:
        table = np.full((3, 4), 1e300 if with_axes else np.inf)
    else:
        table = limit_table(brake_limits)
    found = np.empty(44)
    kernels.certify(
        *(np.empty(0), np.empty((0, 0)), np.empty(0), np.empty((0, 18)), np.zeros(3)),
        *(rows[known:], rows[:known], len(rows) - known, 0, False, False, period, table),
        *(np.full(2, np.inf), 0.0 if brake_limits is None else 1.0, *LAW, found),
    )
    records = found[24:36].reshape(3, 4)
    places = np.where(
        found[:12].reshape(3, 4) > 0.0, records + known - np.arange(1.0, 4.0)[:, None], 0.0
    )
    return Extremes(
        found[:24].reshape(6, 4).tolist(),
        np.maximum(places, 0.0).astype(int).tolist(),
        float(found[40]),
        max(int(found[41]) + known - HISTORY, 0),
        int(found[43]),
    )


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
    """Return what a certificate takes of setpoints, all of it sampled."""
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
    rate, place = _slowest(phases, q, period, brake_limits)
    return replace(found, rate=rate, rate_place=place)


LOCAL = 0.95
"""Share of the limit up to which accelerations at records count for the brake rate."""


def _squares(vectors: Floats, column: int) -> Floats:
    squares: Floats = vectors[:, column - 1] ** 2 if column else np.sum(vectors**2, axis=1)
    return squares


def _slowest(
    phases: list[tuple[Floats, Floats, Floats]],
    q: Floats,
    period: float,
    limits: Limits,
) -> tuple[float, int]:
    """Return the least brake rate at and after every record, and which third difference sets it."""
    count = len(phases[0][2])
    local = np.nan_to_num(q[:, 7:10]) if q.shape[1] == 10 else np.zeros((len(q), 3))
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
        # Those at the three records of the acceleration, as far as they leave a share of the limit.
        sizes = np.sqrt(_squares(local, column))
        most = (limits.acceleration, *limits.axis_acceleration)[column]
        largest = np.lib.stride_tricks.sliding_window_view(sizes[1:], 3).max(axis=1)
        rows[1] = np.maximum(rows[1], np.minimum(largest, LOCAL * most))
        columns.append(rows)
    return least_brake_rate(columns, limits)
