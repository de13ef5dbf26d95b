"""Backward differences of setpoints, as in :mod:`orientd.planner.certify.measuring`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd import kernels
from orientd.model.limits import Limits
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, law
from orientd.planner.certify.measuring import limit_table
from orientd.planner.facts import HISTORY
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
    rows: Floats = np.full((len(q), 10), np.nan)
    rows[:, : q.shape[1]] = q
    known = HISTORY * past
    if brake_limits is None:
        table = np.full((3, 4), np.inf)
    else:
        table = limit_table(brake_limits)
        with_axes = brake_limits.has_axes
    found = np.empty(40)
    kernels.certify(
        *(True, np.empty(0), np.empty((0, 0)), rows[known:], rows[:known], len(rows) - known),
        *(0, False, False, period, table, 0, 4 if with_axes else 1),
        *(0.0 if brake_limits is None else 1.0, *law(FASTEST_BRAKE_RATE), found),
    )
    records = found[24:36].reshape(3, 4)
    places = np.where(
        found[:12].reshape(3, 4) > 0.0, records + known - np.arange(1.0, 4.0)[:, None], 0.0
    )
    return Extremes(
        found[:24].reshape(6, 4).tolist(),
        np.maximum(places, 0.0).astype(int).tolist(),
        float(found[36]),
        max(int(found[37]) + known - HISTORY, 0),
        int(found[39]),
    )


def brake_rate(
    velocity: Floats,
    acceleration: Floats,
    jerk: float,
    most: float,
    most_jerk: float,
    step: float = 1e-5,
) -> float:
    """Return the largest safe brake rate that the kernel finds for one point of a path.

    Args:
        velocity: of three values that are not a turn, shape ``(3,)``.
        acceleration: shape ``(3,)``.
        jerk: its size, in a direction across both.
        most: limit of the acceleration; infinite for none.
        most_jerk: limit of the jerk; infinite for none.
        step: period of a path through the point, s: so short that nothing changes along it.
    """
    across = np.cross(velocity, acceleration)
    size = float(np.linalg.norm(across))
    twist = jerk * (across / size if size else np.array([0.0, 0.0, 1.0]))
    t = step * np.arange(-4.0, 5.0)[:, None]
    rows = np.concatenate(
        [
            t * (velocity + t * (acceleration / 2.0 + t * twist / 6.0)),
            velocity + t * (acceleration + t * twist / 2.0),
        ],
        axis=1,
    )
    table = np.full((3, 4), np.inf)
    table[1:, 0] = most, most_jerk
    return brake_rate_of(rows, step, table, range(1))


def brake_rate_of(rows: Floats, period: float, limits: Floats, columns: range) -> float:
    """Return the largest safe brake rate of a piece of a path that goes on at both ends, 1/s.

    Args:
        rows: three values that are not a turn and their velocities, shape ``(n, 6)``.
        period: s.
        limits: of each order, of the norm and the components, shape ``(orders, 4)``.
        columns: that count: 0 is the norm.
    """
    found = np.empty(40)
    kernels.certify(
        *(False, np.empty(0), np.empty((0, 0)), rows, np.empty((0, 6)), len(rows), 0),
        *(False, False, period, limits, columns.start, columns.stop, 1.0),
        *(*law(FASTEST_BRAKE_RATE), found),
    )
    return float(found[36])


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
