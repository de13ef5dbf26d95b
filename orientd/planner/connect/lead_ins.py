"""Lead-ins: from wherever a device is, and however it moves, to the first keyframe.

From rest that is an approach, and a run-up where the keyframe is passed with a velocity.  From a
motion it is a connector; where none is found, a stop and then the way from rest, so that there is
always an answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner.connect.connector import CONNECTOR_RESERVE, connector
from orientd.planner.connect.leads import approach, approach_cycles, lead_out
from orientd.planner.connect.position_stop import position_lead
from orientd.planner.connect.quintic_connector import join
from orientd.planner.limits import Limits, is_still
from orientd.planner.path import PositionPath
from orientd.planner.request import State

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


@dataclass(frozen=True, slots=True)
class Connection:
    """One way of connecting a motion with another, of those that are tried one after the other.

    Attributes:
        name: in reports of what was tried.
        share: of the limits to use.
        has_reserve: whether acceleration and jerk keep the reserve of a connector.
        ease: share of the jerk that is used where its reserve would make the velocity too high.
        falls_first: whether the acceleration falls before anything else.
        as_found: whether the connector stays as it is found, longer than the limits permit.
        rests: whether it is a stop, and then the way from rest.
    """

    name: str
    share: float = 1.0
    has_reserve: bool = True
    ease: float = _EASED
    falls_first: bool = False
    as_found: bool = False
    rests: bool = False

    def limits(self, limits: Limits) -> Limits:
        """Return the limits to give to :func:`.connector`, which keeps its reserve below them."""
        if self.has_reserve:
            return limits.scaled(self.share)
        return limits.with_reserve(self.share / CONNECTOR_RESERVE)


USUAL: Connection = Connection("the shortest connector")
WITHOUT_RESERVE: tuple[Connection, ...] = (
    Connection("a connector without a reserve", 0.9995, has_reserve=False),
    Connection("a connector with hardly any reserve", 0.998, has_reserve=False),
    Connection("a connector with little reserve", 0.994, has_reserve=False),
)
"""What is tried where the reserve would make a device overshoot, too."""
CONNECTIONS: tuple[Connection, ...] = (
    USUAL,
    # What is drawn between two setpoints goes beyond the jerk's reserve.
    Connection("a connector with more of the jerk's reserve", ease=_LESS_EASED),
    # The acceleration begins just below a limit.
    Connection("a connector after the acceleration has fallen", falls_first=True),
    Connection("a connector with 98 % of the limits", 0.98),
    # The state is at the limits already.
    *WITHOUT_RESERVE,
    Connection("a longer connector", 0.9994, has_reserve=False, as_found=True),
    Connection("a stop, and the way from rest", 0.97, rests=True),
)
"""A peak between the points that were looked at asks for the next one."""


def lead_in(
    start: State,
    first: State,
    *,
    limits: Limits,
    own: Limits,
    period: float,
    is_direct: bool = False,
    connection: Connection = USUAL,
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
        connection: how to connect a motion.
        is_even: whether a way from rest is to be even rather than the quickest.

    Raises:
        PlanError: the first keyframe cannot be passed as fast as *first* says.
    """
    if start.is_at_rest and not is_direct:
        return from_rest(start, first, limits=limits, period=period, is_even=is_even)
    within = connection.limits(limits)
    positions = position_lead(start, first.position, limits=within, period=period)
    least = 0.0 if positions.is_held else float(positions.breaks[-1])
    found = None
    if not connection.rests:
        found = connector(
            start,
            first,
            limits=within,
            own=limits,
            period=period,
            least=least,
            ease=1.0 if not connection.has_reserve else connection.ease / CONNECTOR_RESERVE,
            as_found=is_even or connection.as_found,
            falls_first=connection.falls_first,
        )
    if found is None:
        stopped = connection.limits(own)
        return _by_way_of_rest(start, first, positions, limits=within, own=stopped, period=period)
    if not positions.is_held:
        positions = position_lead(
            start, first.position, limits=within, period=period, least=found.duration
        )
    return LeadIn((found,), round(found.duration / period), positions)


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
            mirrored = State(first.q, -first.omega_body, first.alpha_body, first.position)
            run_up = lead_out(mirrored, limits=limits, period=period)
        except PlanError as error:
            raise PlanError(f"no run-up to the first keyframe: {error}") from error
        rest = run_up.ends()[0][1]
        run_up_cycles = round(run_up.duration / period)
    turn = approach(start.q, rest, limits, is_even=is_even)
    move = float(np.linalg.norm(first.position - start.position))
    cycles = approach_cycles(turn, move, limits=limits, period=period)
    cycles = max(cycles, least - run_up_cycles)
    arrival = cycles * period
    parts = []
    if cycles:
        # Nothing turns while only the position moves.
        still = join(start.q, np.zeros((5, 3)), arrival)
        parts.append(still if turn is None else turn.slowed(arrival))
    cycles += run_up_cycles
    if run_up is not None:
        parts.append(run_up.reversed().shifted(arrival))
    # The position arrives with the approach and waits while the orientation takes its run-up.
    positions = PositionPath.held(first.position).after_move_from(start.position, 0.0, arrival)
    return LeadIn(tuple(parts), cycles, positions)


def _by_way_of_rest(
    start: State,
    first: State,
    positions: PositionPath,
    *,
    limits: Limits,
    own: Limits,
    period: float,
) -> LeadIn:
    """Return a stop, wherever that is, and the way from rest."""
    try:
        stop = lead_out(start, limits=limits, period=period, may_ramp=True)
    except PlanError:
        stop = lead_out(start, limits=own, period=period, may_ramp=True)
    halt = stop.duration
    rest = State.at_rest(stop.ends()[0][1], first.position)
    least = 0 if positions.is_held else round((float(positions.breaks[-1]) - halt) / period)
    onward = from_rest(rest, first, limits=limits, period=period, least=least)
    parts = [stop, *(part.shifted(halt) for part in onward.parts)]
    return LeadIn(tuple(parts), round(halt / period) + onward.cycles, positions)
