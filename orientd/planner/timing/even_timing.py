"""The even timing of a keyframe path: its own, slowed down by one factor until limits are kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from orientd.errors import PlanError, StartError
from orientd.kernels import time_even
from orientd.planner import refusal
from orientd.planner.certify import OFF_GRID, limit_table
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.geometry import Geometry
from orientd.planner.timing.timing import LONGER, shortest
from orientd.tolerances import GUARD_TOLERANCE

_CYCLES_A_STEP = 4
_LONGEST_SEARCH = 256  # times as long as the first guess, where longer ones are other curves
_MOST_REFUSALS = 10  # of leads, the last one at some four times the duration of the first
_LARGEST_STEP = 0.75 * OFF_GRID[1][1]  # of what a step over a period is taken for

Led = TypeVar("Led")


class Pace(NamedTuple):
    """What the records of a keyframe path say of its pace.

    Attributes:
        cycles: the fewest that keep the limits, to 0.1 %; 0 if none were found.
        factor: by which the path should take longer than the cycles that were looked at last.
        coarse: the same of its own duration, from the derivatives at a few instants alone.
    """

    cycles: int
    factor: float
    coarse: float


def pace_of(
    path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    first: int = 0,
    least: int = 1,
    most: int = 0,
    has_one_shape: bool = True,
    everywhere: bool = False,
) -> Pace:
    """Return how many cycles a keyframe path takes at its own pace.

    Only records near the largest rates are looked at; the certificate looks at everything.

    Args:
        path: in any duration.
        limits: to keep.
        period: of the device, s.
        first: cycles to begin with; 0 begins with what the derivatives say.
        least: cycles not to go below.
        most: cycles not to go beyond; fewer than *least* look at no record at all.
        has_one_shape: whether another duration is the same curve at another rate.
        everywhere: whether to look at every record.
    """
    geometry, is_smooth = Geometry.of(path), path.continuity >= 2
    found = time_even(
        *geometry.orientation,
        *geometry.moves,
        limit_table(limits),
        np.array([limits.linear_velocity, limits.linear_acceleration]),
        period,
        *path.held_ends(limits),
        GUARD_TOLERANCE,
        *OFF_GRID[path.continuity],
        0.0 if is_smooth else _LARGEST_STEP,
        has_one_shape,
        everywhere,
        first,
        least,
        most,
    )
    return Pace(*found)


def evenly_paced(
    shape: KeyframePath,
    limits: Limits,
    period: float,
    *,
    intervals: int,
    other: Callable[[float], KeyframePath] | None,
    led: Callable[[KeyframePath], Led],
    everywhere: bool,
    longest: float = LONGEST,
) -> Led | None:
    """Return a path with its leads in the shortest time that keeps the limits.

    Args:
        shape: a path of about that duration.
        limits: to keep, with their reserve.
        period: of the device, s; the path takes a whole number of them.
        intervals: between the keyframes that it passes.
        other: makes the path of another duration, s; ``None`` where that is the same curve at
            another rate.
        led: puts leads to a path.
        everywhere: whether to look at every record at every attempt.
        longest: that it may take, s.

    Returns:
        What *led* made of the path; ``None`` where no duration keeps the limits.

    Raises:
        StartError: as *led* does.
        PlanError: no lead keeps the limits.
    """
    reserved, is_same = limits.with_reserve(), other is None
    pace = partial(pace_of, limits=reserved, period=period, has_one_shape=is_same)
    guess = shape.duration * pace(shape).coarse
    if is_same:
        refusal.check_duration(guess)
        if guess > longest:
            return None
    # Two steps of the acceleration within a difference of the setpoints would add up.
    fewest = 1 if shape.continuity >= 2 else _CYCLES_A_STEP * intervals
    most = int(longest / period)
    if is_same:
        first = math.ceil(guess / period)
    else:
        # There is a curve of that duration; a longer one may swing out further.
        known = math.ceil(shape.duration / period)
        first = math.ceil(guess / period) if guess <= 2 * known * period else known
        most = min(most, _LONGEST_SEARCH * known)
    if most < fewest:
        return None
    refusals: list[PlanError] = []

    def made(cycles: int) -> KeyframePath:
        # The same curve at another rate need not be made again.
        return shape.slowed(cycles * period) if other is None else other(cycles * period)

    def attempt(cycles: int, *, are_led: bool) -> float:
        try:
            path = made(cycles)
        except PlanError:
            return math.inf
        factor = pace(path, first=cycles, least=cycles, most=cycles, everywhere=everywhere).factor
        if factor <= 1.0:
            paths[cycles] = path
            if are_led:
                try:
                    drafts[cycles] = led(path)
                except StartError:
                    raise
                except PlanError as error:
                    refusals.append(error)
                    if len(refusals) == _MOST_REFUSALS:
                        raise
                    return LONGER
        return factor

    paths: dict[int, KeyframePath] = {}
    drafts: dict[int, Led] = {}
    if is_same:
        cycles = pace(shape, first=first, least=fewest, most=most, everywhere=everywhere).cycles
    else:
        alone = partial(attempt, are_led=False)
        cycles = shortest(alone, first, least=fewest, most=most, has_one_shape=False) or 0
    if not cycles:
        return None
    try:
        return led(paths.get(cycles) or made(cycles))
    except StartError:
        raise
    except PlanError:
        # From hold to hold the leads are the same for any duration.
        if is_same and shape.is_held_at_both_ends(limits):
            raise
    # What is found mostly has leads; otherwise every attempt counts with its own.
    some = partial(attempt, are_led=True)
    found = shortest(some, cycles, least=fewest, most=most, has_one_shape=is_same)
    if found is None and refusals:
        raise refusals[-1]
    return None if found is None else drafts[found]
