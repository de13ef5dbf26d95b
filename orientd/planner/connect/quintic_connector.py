"""Quintic connectors of two states of motion: their trajectories, and whether they keep limits.

What a join is stands in ``orientd/kernels/c/connectors.h``.  A state is a row of ten numbers:
orientation, angular velocity and angular acceleration in body components.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd import kernels
from orientd.curves import Indices, Trajectory
from orientd.planner.request import State
from orientd.rotation import Floats

FACTORS = 5
STATE = 10

_MOST_PIECES = 16_384  # of a trajectory of joins

# Sums of Bernstein polynomials of degree 5, each from one on to the last.
_BASIS = np.tri(FACTORS, FACTORS + 1, k=0)[::-1, ::-1].copy()


def joins(q: Floats, w: Floats, breaks: Floats) -> Trajectory:
    """Return joins end to end; where they meet, velocity and acceleration are to be the same.

    Args:
        q: orientations that they begin at, shape ``(n, 4)``.
        w: their half-angle increments, shape ``(n, 5, 3)``.
        breaks: when they begin, and when the last one ends, s, shape ``(n + 1,)``.

    Raises:
        PlanError: they turn too far for a table of moderate size.
    """
    first = FACTORS * np.arange(len(q))
    values = np.repeat(_BASIS[None], len(q), axis=0)
    return Trajectory.of_product(
        breaks, (np.ascontiguousarray(q), first, w.reshape(-1, 3), values), most=_MOST_PIECES
    )


def join(q: Floats, w: Floats, duration: float) -> Trajectory:
    """Return the trajectory of one join, over ``[0, duration]``.

    Args:
        q: orientation it begins at, shape ``(4,)``.
        w: its increments, shape ``(5, 3)``.
        duration: s.
    """
    return joins(q[None], w[None], np.array([0.0, duration]))


def try_joins(
    first: Sequence[Floats],
    last: Sequence[Floats],
    durations: Floats,
    around: State,
    limits: Floats,
) -> tuple[Floats, Indices]:
    """Return the increments of several joins, the shorter way round, and which keep the limits.

    Args:
        first: orientations, velocities and accelerations that they begin with, shapes ``(n, 4)``,
            ``(n, 3)`` and ``(n, 3)``.
        last: those that they end with.
        durations: s, shape ``(n,)``.
        around: velocity and acceleration may be as high as in this state, whatever the limits.
        limits: of norm and components, from
        :func:`~orientd.planner.certify.measuring.limit_table`.

    Returns:
        Increments, shape ``(n, 5, 3)``, and the places of those that keep the limits, in order.
    """
    w: Floats = np.empty((len(durations), FACTORS, 3))
    kept = np.empty(len(durations), dtype=np.int64)
    begins, ends = (
        np.ascontiguousarray(np.concatenate(states[:3], axis=1)) for states in (first, last)
    )
    kernels.try_joins(begins, ends, durations, state_row(around), limits, w, kept)
    return w, np.flatnonzero(kept)


def state_row(state: State) -> Floats:
    """Return a state of motion as a row, shape ``(10,)``."""
    return np.concatenate([state.q, state.omega_body, state.alpha_body])
