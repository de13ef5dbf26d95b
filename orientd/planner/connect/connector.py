"""Connectors: the shortest way found from one state of motion to another, inside the limits.

A connector that is found is a quintic join with, where that is quicker or needed, a ramp before it
and one behind: a ramp changes the acceleration alone, at the limit of the jerk.  From that it is
shortened to what the limits permit, which ``orientd/kernels/c/shorten.h`` explains, and is many
short joins then.  If the acceleration at its beginning has to fall at once, ramps come before it.
"""

from __future__ import annotations

import math

import numpy as np

from orientd import kernels
from orientd.curves import Trajectory
from orientd.planner.certify import limit_table
from orientd.planner.connect.quintic_connector import FACTORS, joins, state_row
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.request import State
from orientd.rotation import angle

CONNECTOR_RESERVE = 0.96
"""Share of acceleration and jerk that a connector uses, so that a motion can be stopped in it."""

_MOST_JOINS = 36
_TURN_SLACK = 1.001  # times the turn that a connector may make, for rounding


def connector(
    start: State,
    end: State,
    *,
    limits: Limits,
    period: float,
    own: Limits | None = None,
    least: float = 0.0,
    ease: float = 1.0,
    as_found: bool = False,
    falls_first: bool = False,
) -> Trajectory | None:
    """Return a trajectory from path time 0 that leads from one state to another, if one is found.

    The velocity, and the acceleration, may be as high as they are at the ends, and otherwise keep
    *limits* with their reserve.  It makes no whole turn that is not needed: it turns at most by the
    angle between both orientations and by what it takes to come to rest from either end.

    Args:
        start: where it begins.
        end: where it ends.
        limits: to keep.
        period: it takes a whole number of periods, s.
        own: limits that the velocity keeps while its acceleration falls, with which it may have to
            begin; by default *limits*.
        least: it takes at least this long, s.
        ease: factor of the jerk with its reserve, where it is needed to stay below the velocity.
        as_found: whether to leave it as it is found rather than as short as the limits permit.
        falls_first: whether the acceleration falls first in any case.
    """
    q, w = np.empty((_MOST_JOINS, 4)), np.empty((_MOST_JOINS, FACTORS, 3))
    breaks = np.empty(_MOST_JOINS + 1)
    within = limits.with_reserve(CONNECTOR_RESERVE)
    stops = turn_to_stop(start, within) + turn_to_stop(end, within)
    count = kernels.connect(
        state_row(start),
        state_row(end),
        limit_table(within),
        limit_table(limits if own is None else own),
        period,
        least,
        LONGEST,
        _TURN_SLACK * (float(angle(start.q, end.q)) + stops),
        ease,
        as_found,
        falls_first,
        q,
        w,
        breaks,
    )
    return joins(q[:count], w[:count], breaks[: count + 1]) if count else None


def turn_to_stop(state: State, limits: Limits) -> float:
    """Return about how far a device turns until it is at rest, rad.

    It is half a double S (Biagiotti and Melchiorri 2008, section 3.4), behind the fall of an
    acceleration.
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
