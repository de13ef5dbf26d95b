r"""Lead-ins from the state of a device to the first keyframe, and lead-outs from the last to rest.

From rest a lead-in is an **approach**, a turn about one axis from rest to rest.  If the first
keyframe has a velocity, a **run-up** follows: the mirror image in time of a lead-out from
:math:`(q, -\omega, \alpha)`.  From a motion, a lead-in is a connector.  A **lead-out** begins in
the final state :math:`(q, \omega, \alpha)` of a motion and comes to rest; its formulas are in
``orientd/kernels/c/stop.c``.  Each takes a whole number of periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from orientd.curves.axis_turn import AxisTurn
from orientd.curves.quintic import QUINTIC, UNIT_ACCELERATION, UNIT_JERK, UNIT_VELOCITY
from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.errors import PlanError
from orientd.mechanism.way import Slew
from orientd.model.limits import Limits, is_still
from orientd.planner.connect.connector import FACTORS, connector, hold, join, stop
from orientd.planner.connect.position_stop import check_lead, position_lead
from orientd.planner.errors import LeadError
from orientd.planner.path import PositionPath
from orientd.planner.state import State
from orientd.planner.timing.axis_turn import phases_of_turn
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle, exp, multiply, nearer_sign

SAME_PLACE = 1e-12  # rad and m

LEAD_SHARE = 0.95
"""Share of acceleration and jerk that leads use: with more of it, stops on them take longer."""

MOST_SHARE = 0.9995
"""Largest share of acceleration and jerk: the law between two records may need the rest."""

_MORE = 1.01  # of acceleration and jerk, for another search for a connector
_TRIES, _FEWEST = 16, 2  # number of times to reach a curve at, and its fewest cycles
_SLACK = 1e-9  # of a period
_ROUNDING = 1e-9  # of a velocity
_SHARES = np.linspace(0.0, 1.0, 65)  # of a lead-out, at which its velocity is looked at


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """The part of a motion before the first keyframe, or after the last.

    Attributes:
        parts: trajectories end to end, from path time 0 on.
        cycles: their duration in periods.
        positions: the position during that time.
        joints: axis angles at its end, rad, if the timing regards them.
        slews: sections in which the axes of a gimbal turn evenly.
    """

    parts: tuple[Trajectory, ...]
    cycles: int
    positions: PositionPath
    joints: Joints = ()
    slews: tuple[Slew, ...] = ()


def lead_in(
    start: State,
    first: State,
    *,
    limits: Limits,
    own: Limits,
    period: float,
    share: float,
    is_direct: bool = False,
    is_even: bool = False,
    least: float = 0.0,
) -> Lead:
    """Return the lead-in from a state to the first keyframe.

    Args:
        first: state at the first keyframe; its position is at rest.
        own: limits for a stop, if *limits* are those of a slower pace and do not allow it.
        share: of acceleration and jerk, for a connector and a run-up.
        is_direct: whether to use a connector from rest too.
        is_even: whether an approach has an even pace.
        least: least duration of a connector, s.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    if start.is_at_rest and not is_direct:
        return from_rest(start, first, limits=limits, period=period, share=share, is_even=is_even)
    positions = position_lead(start, first.position, limits=limits, period=period)
    if not positions.is_held:
        least = max(least, float(positions.breaks[-1]))
    found = connected(start, first, limits=limits, own=own, period=period, share=share, least=least)
    if not positions.is_held:
        positions = position_lead(
            start, first.position, limits=limits, period=period, least=found.duration
        )
    return Lead((found,), round(found.duration / period), positions)


def connected(
    start: State,
    end: State,
    *,
    limits: Limits,
    own: Limits,
    period: float,
    share: float,
    least: float = 0.0,
) -> Trajectory:
    """Return the connector between two states that uses a share of acceleration and jerk.

    The other arguments are those of :func:`lead_in`; *least* is its least duration, s.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    within, stopping = limits.with_reserve(share), own.with_reserve(share)
    more = max(min(_MORE, MOST_SHARE / share), 1.0)
    return connector(start, end, limits=within, own=stopping, period=period, least=least, more=more)


def join_in(
    path: KeyframePath, start: State, *, limits: Limits, period: float, share: float
) -> Trajectory:
    """Return a connector from path time 0 onto a keyframe path.

    For curves that cannot begin at rest, or with a given acceleration.  The connector starts from
    the state of the device and reaches the path, in step with it, shortly after.

    Args:
        path: begins at the orientation of the device.
        start: the commanded state of the device.
        limits: limits of the connector; the path may use them fully itself.
        period: the connector takes a whole number of periods, s.
        share: of acceleration and jerk.

    Raises:
        LeadError: no connector within the first interval keeps the limits.
    """
    most = min(int(path.times[1] / period), math.ceil(path.duration / period) - 1)
    cycles = np.unique(np.geomspace(_FEWEST, max(most, _FEWEST), _TRIES).astype(int))
    find = partial(connected, start, limits=limits, own=limits, period=period, share=share)
    times = period * cycles[cycles <= most]
    rates = path.trajectory.sample(times)
    for time, q, omega, alpha in zip(times.tolist(), *rates, strict=True):
        found = find(State(q, omega, alpha, start.position), least=time - 0.5 * period)
        if found.duration < time + 0.5 * period:
            return found
    raise LeadError(
        "found no connector from the device's state onto the curve; use c2_cumulative, which can "
        "begin with it, or set `approach: true` to plan a lead-in"
    )


def from_rest(
    start: State,
    first: State,
    *,
    limits: Limits,
    period: float,
    share: float,
    is_even: bool = False,
) -> Lead:
    """Return approach and run-up from rest, as far as they are needed.

    Args:
        first: state at the first keyframe.
        share: of acceleration and jerk, for the run-up.
        is_even: as in :func:`lead_in`.

    Raises:
        PlanError: no run-up keeps the limits.
    """
    run_up, rest, run_up_cycles = None, first.q, 0
    if not is_still(first.omega_body, first.alpha_body, limits):
        try:
            mirrored = State(first.q, -first.omega_body, first.alpha_body, first.position)
            run_up = lead_out(mirrored, limits=limits, period=period, share=share)
        except PlanError as error:
            raise PlanError(f"no run-up to the first keyframe: {error}") from error
        rest = run_up.ends()[0][1]
        run_up_cycles = round(run_up.duration / period)
    # Where time is given, a stop on the turn is as short as on the run-up.
    within = limits if is_even else limits.with_reserve(min(share / LEAD_SHARE, 1.0))
    turn = approach(start.q, rest, within, is_even=is_even)
    move = float(np.linalg.norm(first.position - start.position))
    cycles = approach_cycles(turn, move, limits=limits, period=period)
    arrival = cycles * period
    parts = []
    if cycles:
        # Nothing turns while only the position moves.
        still = hold(start.q, arrival)
        parts.append(still if turn is None else turn.slowed(arrival))
    cycles += run_up_cycles
    if run_up is not None:
        parts.append(run_up.reversed().shifted(arrival))
    # The position arrives with the approach and waits during the run-up of the orientation.
    positions = PositionPath.held(first.position)
    if move > SAME_PLACE:
        positions = positions.after_move_from(start.position, arrival)
    return Lead(tuple(parts), cycles, positions)


def straight(start: State, end: State) -> KeyframePath:
    """Return the turn about one axis and along a straight line between two states, not yet timed.

    It is a rest of 1 s if both are at the same place.
    """
    turn, move = float(angle(start.q, end.q)), end.position - start.position
    span = max(turn, float(np.linalg.norm(move)))
    if span <= SAME_PLACE:
        span = 1.0
    trajectory = hold(start.q, span)
    if turn > SAME_PLACE:
        axis, is_shorter = _axis_between(start.q.tolist(), end.q.tolist())
        rate = (turn if is_shorter else 2.0 * math.pi - turn) / span * np.array(axis)
        trajectory = Trajectory.fit(
            lambda times: multiply(start.q, exp(times[:, None] * rate)), [0.0, span]
        )
    positions = PositionPath.held(start.position)
    if move.any():
        pieces = np.zeros((1, QUINTIC, 3))
        pieces[0, 0], pieces[0, 1] = start.position, move / span
        positions = PositionPath(np.array([0.0, span]), pieces, start.position, end.position)
    return KeyframePath(trajectory, positions, np.array([0.0, span]))


def lead_out(start: State, *, limits: Limits, period: float, share: float) -> Trajectory:
    """Return the trajectory from a state to rest, over ``[0, T]``.

    Args:
        start: the state.
        limits: to keep; the velocity may be as high as in *start*.
        period: the lead-out takes a whole number of periods, s.
        share: of acceleration and jerk.

    Raises:
        PlanError: the velocity rises above its limit before the acceleration has fallen, or the
            lead-out takes longer than the longest allowed motion.
    """
    found = stop(start, limits=limits.with_reserve(share), period=period)
    speeds = found.sample(found.duration * _SHARES)[1]
    for rates, most in (
        (np.sqrt(np.einsum("ij,ij->i", speeds, speeds)), limits.velocity),
        (np.abs(speeds), np.array(limits.axis_velocity)),
    ):
        allowed = np.maximum(most, rates[0]) * (1.0 + _ROUNDING)
        if (rates.max(axis=0) > allowed).any():
            raise PlanError(
                f"between rest and {np.linalg.norm(start.omega_body):.4g} rad/s with "
                f"{np.linalg.norm(start.alpha_body):.4g} rad/s^2 none keeps the limits of "
                f"{limits.velocity:g} rad/s, {limits.acceleration:g} rad/s^2 and "
                f"{limits.jerk:g} rad/s^3; use a lower velocity there, or allow more time"
            )
    return found


def approach_cycles(turn: Trajectory | None, move: float, *, limits: Limits, period: float) -> int:
    """Return the fewest periods for a turn and a move from rest to rest; 0 if neither is needed.

    Args:
        turn: the turn of :func:`approach`.
        move: of the position, m.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    most = limits.with_reserve().linear_acceleration
    duration = max(
        0.0 if turn is None else turn.duration,
        UNIT_VELOCITY * move / limits.linear_velocity if move > SAME_PLACE else 0.0,
        math.sqrt(UNIT_ACCELERATION * move / most) if move > SAME_PLACE else 0.0,
    )
    check_lead("an approach", duration)
    return math.ceil(duration / period - _SLACK)


def approach(
    q0: Floats,
    q1: Floats,
    limits: Limits,
    *,
    is_even: bool = False,
    is_part: bool = True,
) -> Trajectory | None:
    """Return the fastest turn from rest at *q0* to rest at *q1*, the short way round.

    It begins at path time 0; ``None`` if both are the same.

    Args:
        is_even: whether to return a quintic instead, as long as its peaks need.
        is_part: whether it is part of a longer motion.

    Raises:
        PlanError: it takes longer than the longest allowed motion.
    """
    turn = float(angle(q0, q1))
    if turn <= SAME_PLACE:
        return None
    axis, is_shorter = _axis_between(q0.tolist(), q1.tolist())
    if not is_shorter:
        turn = 2.0 * math.pi - turn
    if math.isfinite(limits.acceleration) and not is_even:
        phases = phases_of_turn(axis, turn, limits, is_part=is_part)
        check_lead("an approach", float(phases.sum()))
        return AxisTurn(q0, axis, turn, phases).trajectory
    velocity, acceleration, jerk = limits.with_reserve().along(axis.tolist())
    duration = max(
        UNIT_VELOCITY * turn / velocity,
        math.sqrt(UNIT_ACCELERATION * turn / acceleration),
        math.cbrt(UNIT_JERK * turn / jerk),
    )
    check_lead("an approach", duration)
    w = np.zeros((FACTORS, 3))
    w[2] = 0.5 * turn * axis
    return join(q0, w, duration)


def _axis_between(q0: list[float], q1: list[float]) -> tuple[Floats, bool]:
    """Return the axis of the shorter turn between two orientations, in the body frame.

    Also whether it is the shorter one: :func:`.nearer_sign` decides about half turns, and rounding
    can make its choice the longer one.  Plain floats take a tenth of the time of arrays here.
    """
    (w0, x0, y0, z0), (w1, x1, y1, z1) = q0, q1
    w = w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1
    x = w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1
    y = w0 * y1 - y0 * w1 - z0 * x1 + x0 * z1
    z = w0 * z1 - z0 * w1 - x0 * y1 + y0 * x1
    sign = nearer_sign(w, x, y, z)
    scale = sign / math.hypot(x, y, z)
    return np.array([scale * x, scale * y, scale * z]), sign * w >= 0.0
