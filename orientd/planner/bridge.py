r"""Bridges: the shortest way found from one state of motion to another, inside the limits.

A bridge is a quintic join with, where that is quicker or needed, a ramp before it and one behind:
a ramp changes the acceleration alone, at the limit of the jerk.  Without a ramp a quintic that
begins with a large acceleration keeps some of it for long, and may not keep the limit of the
velocity for any duration.  :mod:`orientd.planner.bridge_search` finds them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orientd.errors import PlanError
from orientd.planner import bridge_search
from orientd.planner.bridge_search import Bounds, Way
from orientd.planner.fast import kernels
from orientd.planner.limit_table import limit_table
from orientd.planner.limits import Limits
from orientd.planner.path import Stretch
from orientd.planner.quintic import AT_FINE, TO_RATES, Ends, Joins, join
from orientd.planner.request import State
from orientd.rotation import Floats, angle


def bridge(
    start: State, end: State, *, limits: Limits, period: float, least: float = 0.0
) -> Stretch:
    """Return a stretch from path time 0 that leads from one state to another.

    The velocity, and the acceleration, may be as high as they are at the ends, and otherwise keep
    *limits* with their reserve.

    Args:
        start: where it begins.
        end: where it ends.
        limits: to keep.
        period: it takes a whole number of periods, s.
        least: it takes at least this long, s.

    Raises:
        PlanError: nothing was found.
    """
    way = _searched(start, end, limits, period, least)
    if way is None:
        raise PlanError(
            f"no way found from {np.linalg.norm(start.omega_body):.4g} rad/s to "
            f"{np.linalg.norm(end.omega_body):.4g} rad/s over {angle(start.q, end.q):.4g} rad"
        )
    _, before, after, total = way.times.tolist()
    # A ramp that takes no time is none.
    first, last = int(before == 0.0), 3 - int(after == total)
    joins = Joins(way.q[first:last], way.w[first:last], way.times[first : last + 1])
    return Stretch(joins, 0.0, total)


def _searched(start: State, end: State, limits: Limits, period: float, least: float) -> Way | None:
    compiled = kernels().search
    if compiled is None:
        return bridge_search.search(start, end, limits, period, least)
    way = Way(np.empty((3, 4)), np.empty((3, 5, 3)), np.empty(4))
    is_found = compiled(
        _row(start),
        _row(end),
        limit_table(limits.with_reserve()),
        limits.has_axes,
        period,
        least,
        TO_RATES,
        AT_FINE,
        *way,
    )
    return way if is_found else None


def _row(state: State) -> Floats:
    return np.concatenate([state.q, state.omega_body, state.alpha_body])


def ramped_stops(
    state: State, limits: Limits, period: float
) -> Iterator[tuple[Stretch | None, State]]:
    """Yield ramps that a stop may begin with, of whole periods, and the states they lead to.

    The first one is none at all.
    """
    bounds = Bounds.of(state, state, limits)
    ramps = bridge_search.ramps(state, np.zeros(3), bounds, limits, period, in_cycles=True)
    begin = Ends(state.q, state.omega_body, state.alpha_body)
    for index, duration in enumerate(ramps.durations.tolist()):
        end = Ends(*(part[index] for part in ramps.ends))
        ramp = None
        if duration:
            w = bridge_search.increments_of(begin, end, duration)
            ramp = Stretch(join(begin.q, w, duration), 0.0, duration)
        yield ramp, State(*end, state.position)
