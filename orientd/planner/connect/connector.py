"""Connectors between two states of motion, and stops, within the limits.

A stop has a closed form of three phases of constant jerk (``orientd/kernels/c/stop.c``).  A
connector is a stop, a turn and a run-up, which always exists, made as short as the limits permit;
see ``orientd/kernels/c/shorten.h``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orientd import kernels
from orientd.curves.trajectory import PIECE, Trajectory
from orientd.errors import PlanError
from orientd.model.limits import LONGEST, Limits
from orientd.planner.certify.measuring import limit_table
from orientd.planner.state import State
from orientd.rotation import Floats, angle

FACTORS = 5
_MOST_PIECES = 16_384  # of a product
_MOST_PHASES = 64  # in the first table
# Sums of Bernstein polynomials of degree 5, each from one on to the last.
_BASIS = np.tri(FACTORS, FACTORS + 1, k=0)[::-1, ::-1].copy()
_TURN_SLACK = 1.001  # tolerance of the largest turn of a connector, for rounding


def join(q: Floats, w: Floats, duration: float) -> Trajectory:
    """Return the cumulative Bernstein product of degree 5 over ``[0, duration]``.

    Args:
        q: initial orientation.
        w: half-angle increments, shape ``(5, 3)``.
        duration: s.

    Raises:
        PlanError: it turns too far for a table of moderate size.
    """
    product = q[None], np.zeros(1, dtype=np.int64), w, _BASIS[None]
    return Trajectory.of_product(np.array([0.0, duration]), product, most=_MOST_PIECES)


def hold(q: Floats, duration: float) -> Trajectory:
    """Return the trajectory that stays at *q* for a duration, s."""
    return join(q, np.zeros((FACTORS, 3)), duration)


def connector(
    start: State,
    end: State,
    *,
    limits: Limits,
    own: Limits,
    period: float,
    least: float = 0.0,
    more: float = 1.0,
) -> Trajectory:
    """Return a trajectory from path time 0 between two states.

    It begins as a stop, a turn and a run-up.  A shorter one replaces that, but makes no unnecessary
    whole turn: it turns at most by the angle between both orientations plus the turn of a stop from
    either end.  It may also turn as far as the way that it replaces.

    Args:
        start: initial state.
        end: final state.
        limits: with their reserve; velocity and acceleration may be as high as at the ends.
        own: limits of the stop.
        period: the trajectory takes a whole number of periods, s.
        least: least duration, s.
        more: multiple of acceleration and jerk for another search, where a single limit holds up
            the first one.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    stops = turn_to_stop(start, limits) + turn_to_stop(end, limits)
    most_turn = _TURN_SLACK * (float(angle(start.q, end.q)) + stops)
    tables = limit_table(limits), limit_table(own)
    states = state_row(start), state_row(end)
    return _of_phases(kernels.connect, *states, *tables, period, least, LONGEST, most_turn, more)


def stop(state: State, *, limits: Limits, period: float) -> Trajectory:
    """Return the quickest stop of three phases of constant jerk, over ``[0, T]``.

    Args:
        state: initial state.
        limits: with their reserve.
        period: the stop takes a whole number of periods, s.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    return _of_phases(kernels.stop, state_row(state), limit_table(limits), period, LONGEST)


def _of_phases(kernel: Callable[..., int], *given: Floats | float) -> Trajectory:
    room = _MOST_PHASES
    while True:
        breaks, pieces = np.empty(room + 1), np.empty((room, PIECE))
        count = kernel(*given, breaks, pieces)
        if not count:
            raise PlanError(f"a stop takes too long, at most {LONGEST:g} s is planned")
        if count <= room:
            breaks = breaks[: count + 1]
            return Trajectory(breaks, pieces[:count], breaks)
        room = count


def turn_to_stop(state: State, limits: Limits) -> float:
    """Return the approximate turn of a device until it is at rest, rad: that along its axis."""
    speed = float(np.linalg.norm(state.omega_body))
    if not speed:
        return 0.0
    direction = state.omega_body / speed
    _, most, jerk = limits.along(direction.tolist())
    rise = max(0.0, float(direction @ state.alpha_body))
    return kernels.stop_along(speed, rise, most, jerk)[1]


def state_row(state: State) -> Floats:
    """Return orientation, angular velocity and acceleration of a state, shape ``(10,)``."""
    return np.concatenate([state.q, state.omega_body, state.alpha_body])
