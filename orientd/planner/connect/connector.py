"""Connectors: the shortest way found from one state of motion to another, inside the limits.

A connector that is found is a quintic join with, where that is quicker or needed, a ramp before it
and one behind: a ramp changes the acceleration alone, at the limit of the jerk.  From that it is
shortened to what the limits permit, which ``orientd/kernels/c/shorten.h`` explains, and is many
short joins then.  Where there is none it begins with guesses, and with limits of axes, too: there
may then be several connectors that are shorter than all near them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from orientd import kernels
from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner.certify import limit_table
from orientd.planner.connect.leads import check_lead
from orientd.planner.connect.quintic_connector import (
    FACTORS,
    STATE,
    join,
    joins,
    state_row,
)
from orientd.planner.limits import ACCELERATION_RESERVE, Limits
from orientd.planner.request import State
from orientd.rotation import Floats, angle

MOST_JOINS = 34
"""That a connector is made of once it is as short as the limits permit."""

CONNECTOR_RESERVE = 0.96
"""Share of acceleration and jerk that a connector uses, so that a motion can be stopped in it."""

_Given = tuple[Floats, Floats, Floats, float, float, float]

_GUESSES = ((1.0, 0.6), (0.0, 1.3))
"""Rates at the ends, and durations, of guesses, as shares: see ``guess_connector``."""

_LONGER = 8.0  # times a guess of how long a connector takes
_RAMPS = 6  # at most, that a stop may begin with
_VERGE = 0.99  # of the velocity: what rises beyond has to let its acceleration fall at once
_FALL = 0.999  # of the jerk, with which it falls
_FALLS = 2  # ramps in which it falls, at most
_TURN_SLACK = 1.001  # times the turn that a connector may make, for rounding
_STILL = 1e-6  # of the velocity: what rises by less has no acceleration to speak of


def connector(
    start: State,
    end: State,
    *,
    limits: Limits,
    period: float,
    least: float = 0.0,
    is_even: bool = False,
    ease: float = 1.0,
) -> Trajectory:
    """Return a trajectory from path time 0 that leads from one state to another.

    The velocity, and the acceleration, may be as high as they are at the ends, and otherwise keep
    *limits* with their reserve.  It makes no whole turn that is not needed: it turns at most by the
    angle between both orientations and by what it takes to come to rest from either end.

    Args:
        start: where it begins.
        end: where it ends.
        limits: to keep.
        period: it takes a whole number of periods, s.
        least: it takes at least this long, s.
        is_even: whether to leave it as it is found rather than as short as the limits permit.
        ease: factor of the jerk with its reserve, where it is needed to stay below the velocity.

    Raises:
        PlanError: nothing was found, or it takes longer than is planned.
    """
    within = limits.with_reserve(CONNECTOR_RESERVE)
    stops = turn_to_stop(start, within) + turn_to_stop(end, within)
    most_turn = _TURN_SLACK * (float(angle(start.q, end.q)) + stops)
    given = state_row(start), state_row(end), limit_table(within), period, least, most_turn
    found = _Found.empty()
    is_found = kernels.find_connector(*given, *found)
    if is_found:
        check_lead("a connector", found.end)
    if not is_even:
        ways = [_shortened(given, found, found.end - period, ease)] if is_found else []
        if not any(ways) or limits.has_axes:
            ways += [_shortened_guess(given, *guess, ease) for guess in _GUESSES]
        shorter = [way for way in ways if way and not (is_found and way.duration >= found.end)]
        if shorter:
            return min(shorter, key=lambda way: way.duration)
    if not is_found:
        raise PlanError(
            f"no way found from {np.linalg.norm(start.omega_body):.4g} rad/s to "
            f"{np.linalg.norm(end.omega_body):.4g} rad/s over {angle(start.q, end.q):.4g} rad"
        )
    # A ramp that takes no time is none.
    _, before, after, total = found.times.tolist()
    first, last = int(before == 0.0), 3 - int(after == total)
    return joins(found.q[first:last], found.w[first:last], found.times[first : last + 1])


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


class _Found(NamedTuple):
    """What the kernels write of a connector: a ramp, a join and another ramp."""

    q: Floats
    w: Floats
    times: Floats

    @classmethod
    def empty(cls) -> _Found:
        return cls(np.empty((3, 4)), np.empty((3, FACTORS, 3)), np.empty(4))

    @property
    def end(self) -> float:
        return float(self.times[-1])


def _shortened(given: _Given, found: _Found, longest: float, ease: float) -> Trajectory | None:
    """Return what a connector is shortened to, if that takes no longer."""
    begins, increments = np.empty((MOST_JOINS, 4)), np.empty((MOST_JOINS, FACTORS, 3))
    breaks = np.empty(MOST_JOINS + 1)
    count = kernels.shorten_connector(*given, longest, ease, *found, begins, increments, breaks)
    if not count:
        return None
    return joins(begins[:count], increments[:count], breaks[: count + 1])


def _shortened_guess(
    given: _Given, rates: float, duration: float, ease: float
) -> Trajectory | None:
    """Return what a connector is that begins with a guess, if one comes of it."""
    guess = _Found.empty()
    kernels.guess_connector(*given[:-1], rates, duration, *guess)
    return _shortened(given, guess, _LONGER * guess.end, ease)


def ramped_stops(
    state: State, limits: Limits, period: float
) -> Iterator[tuple[Trajectory | None, State]]:
    """Yield ramps that a stop may begin with, of whole periods, and the states they lead to.

    The first one is none at all.
    """
    ends, w = np.empty((_RAMPS, STATE)), np.empty((_RAMPS, FACTORS, 3))
    durations = np.empty(_RAMPS)
    table = limit_table(limits.with_reserve())
    count = kernels.ramps_of_stop(state_row(state), table, period, ends, w, durations)
    for end, increments, duration in zip(ends[:count], w, durations.tolist(), strict=False):
        ramp = join(state.q, increments, duration) if duration else None
        yield ramp, State(end[:4], end[4:7], end[7:], state.position)


def fallen(
    state: State, limits: Limits, period: float, *, is_wanted: bool = False
) -> tuple[list[Trajectory], State]:
    """Return the ramps in which an acceleration falls that has to, and the state they lead to.

    What rises to a limit of its velocity with all of the jerk has to let the acceleration fall at
    once, since no join that bends a little later keeps that limit.  Whole periods at that jerk may
    leave a little of it, which one more takes away.

    Args:
        state: where the device is commanded to be.
        limits: to keep.
        period: each ramp takes a whole number of periods, s.
        is_wanted: whether it is to fall in any case.

    Returns:
        No ramp where the acceleration may go on.
    """
    ramps: list[Trajectory] = []
    within = limits.with_reserve(_FALL / ACCELERATION_RESERVE)
    while len(ramps) < _FALLS and (_has_to_fall(state, limits) or is_wanted):
        found = ((ramp, end) for ramp, end in ramped_stops(state, within, period) if ramp)
        ramp, state = next(found, (None, state))
        if ramp is None:
            break
        ramps.append(ramp.shifted(ramps[-1].domain[1] if ramps else 0.0))
        is_wanted = False
    return ramps, state


def _has_to_fall(state: State, limits: Limits) -> bool:
    velocity, _, jerk = limit_table(limits)
    duration = float(np.max(_sizes(state.alpha_body) / jerk))
    shares = _sizes(state.omega_body) / velocity
    reached = _sizes(state.omega_body + 0.5 * duration * state.alpha_body) / velocity
    return bool(np.any(reached > np.maximum(_VERGE, shares + _STILL)))


def _sizes(vector: Floats) -> Floats:
    """Return the norm of a vector and the sizes of its components, shape ``(4,)``."""
    return np.abs([np.linalg.norm(vector), *vector])
