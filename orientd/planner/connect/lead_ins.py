"""Lead-ins: from wherever a device is, and however it moves, to the first keyframe.

From rest that is an approach, and a run-up where the keyframe is passed with a velocity.  From a
motion it is a connector, after the acceleration has fallen where it has to at once; where none is
found, a stop and then the way from rest, so that there is always an answer.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from functools import partial

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner.connect.connector import (
    CONNECTOR_RESERVE,
    connector,
    fallen,
    ramped_stops,
)
from orientd.planner.connect.leads import approach, approach_cycles, lead_out
from orientd.planner.connect.position_stop import position_lead
from orientd.planner.connect.quintic_connector import join
from orientd.planner.limits import Limits, is_still
from orientd.planner.path import PositionPath
from orientd.planner.request import State
from orientd.rotation import Floats

_SLACK = 1e-9  # of a period
_EASED = 0.993  # of the jerk, beyond which a stop would take far longer
_LESS_EASED = 0.985


@dataclass(frozen=True, slots=True, eq=False)
class LeadIn:
    """What comes before the first keyframe.

    Attributes:
        parts: end to end, from path time 0 on.
        cycles: how many periods they take.
        positions: what the position does meanwhile.
    """

    parts: tuple[Trajectory, ...]
    cycles: int
    positions: PositionPath


class Caution(Enum):
    """How to lead in: a peak between the points that were looked at asks for the next one."""

    NONE = 1.0
    LESS_EASED = 0.9999
    """With more of the jerk's reserve, where what is drawn between two setpoints goes beyond it."""
    FALLING_FIRST = 0.9998
    """With the acceleration taken away before anything else, where it begins just below a limit."""
    SOME = 0.98
    AT_LIMITS = 0.9995
    """Without the reserve, for a state that is at the limits already."""
    JUST_BELOW_LIMITS = 0.998
    """The same with a little of it, for what is drawn where the jerk has a step."""
    NEAR_LIMITS = 0.994
    """The same with a little more."""
    AS_FOUND = 0.9994
    """The same with a connector as it is found, which a shorter one has gone beyond a limit for."""
    BY_WAY_OF_REST = 0.97
    """By a stop and a way from rest, which takes longest."""

    @property
    def share(self) -> float:
        """Share of the limits to use."""
        return self.value

    @property
    def ease(self) -> float:
        """Factor by which what is used of the jerk may go beyond its reserve."""
        if self.is_at_limits:
            return 1.0
        return (_LESS_EASED if self is Caution.LESS_EASED else _EASED) / CONNECTOR_RESERVE

    @property
    def is_at_limits(self) -> bool:
        """Whether to do without the reserve."""
        return self in (*WITHOUT_RESERVE, Caution.AS_FOUND)


WITHOUT_RESERVE = (Caution.AT_LIMITS, Caution.JUST_BELOW_LIMITS, Caution.NEAR_LIMITS)
"""What is tried where the reserve would make a device overshoot."""


def lead_in(
    start: State,
    first: State,
    *,
    limits: Limits,
    own: Limits,
    period: float,
    is_direct: bool = False,
    caution: Caution = Caution.NONE,
    is_even: bool = False,
) -> LeadIn:
    """Return the way from a state to the first keyframe.

    Args:
        start: where the device is commanded to be.
        first: at the first keyframe; its position is at rest.
        limits: to keep.
        own: to stop within where *limits*, those of a slower pace, do not allow it.
        period: it takes a whole number of periods, s.
        is_direct: whether to look for a connector from rest, too.
        caution: what to do with less than the limits, and how.
        is_even: whether a way from rest is to be even rather than the quickest.

    Raises:
        PlanError: the first keyframe cannot be passed as fast as *first* says.
    """
    if start.is_at_rest and not is_direct:
        return from_rest(start, first, limits=limits, period=period, is_even=is_even)
    within, stopped = (
        some.with_reserve(caution.share / CONNECTOR_RESERVE)
        if caution.is_at_limits
        else some.scaled(caution.share)
        for some in (limits, own)
    )
    positions = position_lead(start, first.position, limits=within, period=period)
    by_way_of_rest = partial(
        _by_way_of_rest, start, first, positions, limits=within, own=stopped, period=period
    )
    if caution is Caution.BY_WAY_OF_REST:
        return by_way_of_rest()
    least = 0.0 if positions.is_held else float(positions.breaks[-1])
    connect = partial(
        connector,
        end=first,
        limits=within,
        period=period,
        is_even=is_even or caution is Caution.AS_FOUND,
        ease=caution.ease,
    )
    ways: list[list[Trajectory]] = []
    is_falling = caution is Caution.FALLING_FIRST
    if not is_falling:
        with suppress(PlanError):
            ways.append([connect(start, least=least)])
    ramps, end = fallen(start, limits, period, is_wanted=is_falling)
    if ramps:
        begin = ramps[-1].domain[1]
        with suppress(PlanError):
            ways.append([*ramps, connect(end, least=least - begin).shifted(begin)])
    if not ways:
        return by_way_of_rest()
    parts = min(ways, key=lambda way: way[-1].domain[1])
    end_time = parts[-1].domain[1]
    if not positions.is_held:
        positions = position_lead(
            start, first.position, limits=within, period=period, least=end_time
        )
    return LeadIn(tuple(parts), round(end_time / period), positions)


def from_rest(
    start: State,
    first: State,
    *,
    limits: Limits,
    period: float,
    least: int = 0,
    is_even: bool = False,
) -> LeadIn:
    """Return approach and run-up from rest, as far as they are needed.

    Args:
        start: where the device holds.
        first: at the first keyframe.
        limits: to keep.
        period: it takes a whole number of periods, s.
        least: periods that it takes at least.
        is_even: as in :func:`lead_in`.

    Raises:
        PlanError: no run-up keeps the limits.
    """
    run_up, rest, run_up_cycles = None, first.q, 0
    if not is_still(first.omega_body, first.alpha_body, limits):
        try:
            run_up = lead_out(
                first.q, -first.omega_body, first.alpha_body, limits=limits, period=period
            )
        except PlanError as error:
            raise PlanError(f"no run-up to the first keyframe: {error}") from error
        rest = run_up.ends()[0][1]
        run_up_cycles = round(run_up.duration / period)
    cycles = approach_cycles(
        start.q,
        rest,
        start.position,
        first.position,
        limits=limits,
        period=period,
        is_even=is_even,
    )
    cycles = max(cycles, least - run_up_cycles)
    arrival = cycles * period
    parts = []
    if cycles:
        parts.append(_waiting(approach(start.q, rest, limits, is_even=is_even), start.q, arrival))
    cycles += run_up_cycles
    if run_up is not None:
        parts.append(run_up.reversed().shifted(arrival))
    # The position arrives with the approach and waits while the orientation takes its run-up.
    positions = PositionPath.held(first.position).after_move_from(start.position, 0.0, arrival)
    return LeadIn(tuple(parts), cycles, positions)


def _waiting(turn: Trajectory | None, q: Floats, arrival: float) -> Trajectory:
    """Return a turn that takes longer, or none at all, while the position moves."""
    if turn is None:
        return join(q, np.zeros((5, 3)), arrival)
    return turn.slowed(arrival)


def stop(start: State, *, limits: Limits, period: float) -> list[Trajectory]:
    """Return the way from a state to rest, wherever that is, from path time 0 on.

    Raises:
        PlanError: nothing was found.
    """
    best: list[Trajectory] = []
    error: PlanError | None = None
    for ramp, end in ramped_stops(start, limits, period):
        begin = ramp.duration if ramp is not None else 0.0
        try:
            lead = lead_out(end.q, end.omega_body, end.alpha_body, limits=limits, period=period)
        except PlanError as problem:
            error = problem
            continue
        if not best or begin + lead.duration < best[-1].domain[1]:
            best = [] if ramp is None else [ramp]
            best.append(lead.shifted(begin))
    if not best:
        raise PlanError(f"no way to rest: {error}")
    return best


def _by_way_of_rest(
    start: State,
    first: State,
    positions: PositionPath,
    *,
    limits: Limits,
    own: Limits,
    period: float,
) -> LeadIn:
    try:
        parts = stop(start, limits=limits, period=period)
    except PlanError:
        parts = stop(start, limits=own, period=period)
    halt = parts[-1].domain[1]
    rest = State.at_rest(parts[-1].ends()[0][1], first.position)
    least = 0 if positions.is_held else round((float(positions.breaks[-1]) - halt) / period)
    onward = from_rest(rest, first, limits=limits, period=period, least=least)
    parts += [part.shifted(halt) for part in onward.parts]
    return LeadIn(tuple(parts), round(halt / period) + onward.cycles, positions)
