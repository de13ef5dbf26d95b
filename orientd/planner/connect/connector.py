"""Connectors between two states of motion, and stops, within the limits.

A stop has a closed form of three phases of constant jerk (``orientd/kernels/c/stop.c``).  A
connector is a stop, a turn and a run-up, which always exists, made as short as the limits permit;
see ``orientd/kernels/c/shorten.h``.  Joins are quintic pieces with given states at their ends; see
``orientd/kernels/c/connectors.h``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from orientd import kernels
from orientd.curves.basis import Indices
from orientd.curves.trajectory import PIECE, Trajectory
from orientd.errors import PlanError
from orientd.model.limits import LONGEST, Limits
from orientd.planner.certify.measuring import limit_table
from orientd.planner.errors import JoinError
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle, exp, multiply

FACTORS = 5
_MOST_PIECES = 16_384  # Most intervals of a trajectory of joins.
_MOST_PHASES = 64  # in the first table
# Sums of Bernstein polynomials of degree 5, each from one on to the last.
_BASIS = np.tri(FACTORS, FACTORS + 1, k=0)[::-1, ::-1].copy()
_SAME = 1e-9  # of a duration
_TURN_SLACK = 1.001  # tolerance of the largest turn of a connector, for rounding
_TRIES, _FEWEST = 60, 2  # number of durations to try for a join onto a curve, and its fewest cycles


def joins(q: Floats, w: Floats, breaks: Floats) -> Trajectory:
    """Return joins end to end; velocity and acceleration must agree where two of them meet.

    Args:
        q: their initial orientations, shape ``(n, 4)``.
        w: their half-angle increments, shape ``(n, 5, 3)``.
        breaks: their start times, and the end of the last one, s, shape ``(n + 1,)``.

    Raises:
        PlanError: they turn too far for a table of moderate size.
    """
    first = FACTORS * np.arange(len(q))
    values = np.repeat(_BASIS[None], len(q), axis=0)
    return Trajectory.of_product(
        breaks, (np.ascontiguousarray(q), first, w.reshape(-1, 3), values), most=_MOST_PIECES
    )


def join(q: Floats, w: Floats, duration: float) -> Trajectory:
    """Return the trajectory of one join over ``[0, duration]``; see :func:`joins`."""
    return joins(q[None], w[None], np.array([0.0, duration]))


def hold(q: Floats, duration: float) -> Trajectory:
    """Return the trajectory that stays at *q* for a duration, s."""
    return join(q, np.zeros((FACTORS, 3)), duration)


def try_joins(
    first: Sequence[Floats],
    last: Sequence[Floats],
    durations: Floats,
    around: State,
    limits: Limits,
) -> tuple[Floats, Indices]:
    """Return the increments of several joins, the shorter way round, and which keep the limits.

    Args:
        first: their initial orientations, velocities and accelerations, shapes ``(n, 4)``, ``(n,
            3)`` and ``(n, 3)``.
        last: their final ones.
        durations: s, shape ``(n,)``.
        around: a state whose velocity and acceleration are allowed even beyond the limits.
        limits: of norm and components.

    Returns:
        Increments, shape ``(n, 5, 3)``, and the indices of those that keep the limits, in order.
    """
    w: Floats = np.empty((len(durations), FACTORS, 3))
    kept = np.empty(len(durations), dtype=np.int64)
    begins, ends = (
        np.ascontiguousarray(np.concatenate(states[:3], axis=1)) for states in (first, last)
    )
    kernels.try_joins(begins, ends, durations, state_row(around), limit_table(limits), w, kept)
    return w, np.flatnonzero(kept)


def sample_joins(q: Floats, w: Floats, shares: Floats) -> Floats:
    """Return orientations on several joins at shares of their durations.

    Args:
        q: their initial orientations, shape ``(n, 4)``.
        w: their half-angle increments, shape ``(n, 5, 3)``.
        shares: in [0, 1], shape ``(m,)``.

    Returns:
        Shape ``(n, m, 4)``; the sign is continuous.
    """
    powers = np.arange(FACTORS + 1)
    binomials = np.array([math.comb(FACTORS, k) for k in powers])
    u = shares[:, None]
    values = (binomials * u**powers * (1.0 - u) ** (FACTORS - powers)) @ _BASIS.T
    orientations = np.repeat(q[:, None], len(shares), axis=1)
    for factor in range(FACTORS):
        turns = 2.0 * values[:, factor, None] * w[:, None, factor]
        orientations = multiply(orientations, exp(turns))
    return orientations


def join_in(path: KeyframePath, start: State, *, limits: Limits, period: float) -> Trajectory:
    """Return the shortest trajectory from path time 0 onto a keyframe path.

    For curves that cannot begin at rest, or with a given acceleration.  A join starts from the
    state of the device and reaches the path, in step with it, shortly after.

    Args:
        path: begins at the orientation of the device.
        start: the commanded state of the device.
        limits: limits of the join; the path may use them fully itself.
        period: the join takes a whole number of periods, s.

    Raises:
        JoinError: no join within the first interval keeps the limits.
    """
    most = min(int(path.times[1] / period), math.ceil(path.duration / period) - 1)
    cycles = np.unique(np.geomspace(_FEWEST, max(most, _FEWEST), _TRIES).astype(int))
    durations = period * cycles[cycles <= most]
    if len(durations):
        here = (start.q, start.omega_body, start.alpha_body)
        first = [np.tile(part, (len(durations), 1)) for part in here]
        last = path.trajectory.sample(durations)
        w, kept = try_joins(first, last, durations, start, limits)
        if len(kept):
            return join(start.q, w[kept[0]], float(durations[kept[0]]))
    raise JoinError(
        "found no connector from the device's state onto the curve; use c2_cumulative, which can "
        "begin with it, or set `approach: true` to plan a lead-in"
    )


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

    It begins as a stop, a turn and a run-up.  If a shorter one is found, that replaces it; it makes
    no unnecessary whole turn: it turns at most by the angle between both orientations plus the turn
    of a stop from either end.

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


def connector_lasting(
    start: State, end: State, duration: float, *, limits: Limits, own: Limits, period: float
) -> Trajectory | None:
    """Return a trajectory between two states that takes a given duration, if one is found.

    Args:
        start: initial state.
        end: final state.
        duration: s.
        limits: limits to keep.
        own: as for :func:`connector`.
        period: about the time between two of its pieces, s.
    """
    # Whole periods fill the duration exactly.
    whole = duration / max(round(duration / period), 1)
    found = connector(
        start, end, limits=limits, own=own, period=whole, least=duration - 0.5 * whole
    )
    return found if abs(found.duration - duration) < _SAME * duration else None


def turn_to_stop(state: State, limits: Limits) -> float:
    """Return the approximate turn of a device until it is at rest, rad.

    It is half a double S (Biagiotti and Melchiorri 2008, section 3.4), after the acceleration has
    fallen.
    """
    speed = float(np.linalg.norm(state.omega_body))
    if not speed:
        return 0.0
    direction = state.omega_body / speed
    _, most, jerk = limits.along(direction.tolist())
    rise = max(0.0, float(direction @ state.alpha_body))
    fall = rise / jerk
    highest = speed + 0.5 * rise * fall
    is_long = highest * jerk > most**2
    half = 0.5 * (highest / most + most / jerk) if is_long else math.sqrt(highest / jerk)
    return speed * fall + rise * fall**2 / 3.0 + highest * half


def state_row(state: State) -> Floats:
    """Return orientation, angular velocity and acceleration of a state, shape ``(10,)``."""
    return np.concatenate([state.q, state.omega_body, state.alpha_body])
