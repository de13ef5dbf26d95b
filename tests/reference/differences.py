"""Backward differences of setpoints, as in :mod:`orientd.planner.certify.measuring`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd import kernels
from orientd.model.limits import Limits
from orientd.planner import HISTORY
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.planner.certify.measuring import STATE, limit_table
from orientd.rotation import Floats, conjugate, log, multiply


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
    """Return what the kernel finds.

    Args:
        q: orientations, shape ``(n, 4)``; or with rates, shape ``(n, 10)``, where the path between
            the records is to count, too.
        past: 1 where the first three setpoints are those before the records.
        with_axes: whether the components are wanted.
        period: s.
        brake_limits: for a certificate.
    """
    rows = np.zeros((len(q), STATE))
    rows[:, 4:10] = np.nan
    rows[:, : q.shape[1]] = q
    known = HISTORY * past
    if brake_limits is None:
        table = np.full((3, 4), 1e300 if with_axes else np.inf)
    else:
        table = limit_table(brake_limits)
    found = np.empty(46)
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
