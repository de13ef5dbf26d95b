"""The even timing of a keyframe path: its own, slowed down by one factor until limits are kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from orientd.kernels import time_even
from orientd.model import LONGEST, Limits
from orientd.planner import refusal
from orientd.planner.certify import OFF_GRID, limit_table
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.tolerances import GUARD_TOLERANCE

PRECISION = 1e-3
"""Of the shortest duration."""

_CYCLES_A_STEP = 4
_LARGEST_STEP = 0.75 * OFF_GRID[1][1]  # of what a step over a period is taken for
_LONGEST_SEARCH = 256  # times as long as the first guess, where longer ones are other curves
_MOST_ATTEMPTS = 40
_LONGEST_STRIDE = 2.0  # from one duration to the next where the shape changes with it
_FAR = 2.0  # a factor beyond which it is doubted that it falls with the duration
_DOWNWARD = 1.4
_MOST_PREDICTIONS = 8  # attempts that trust the prediction; then bisection
_GROWTH = 1.05
_LEAST, _GREATEST = 1e-9, 1e4  # factors that a prediction is made from


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
        first: cycles to begin with; 0 begins with what the derivatives say.
        least: cycles not to go below.
        most: cycles not to go beyond; fewer than *least* look at no record at all.
        has_one_shape: whether another duration is the same curve at another rate.
        everywhere: whether to look at every record.

    """
    trajectory, is_smooth = path.trajectory, path.trajectory.continuity >= 2
    found = time_even(
        trajectory.breaks,
        trajectory.pieces,
        trajectory.knots,
        *path.moves,
        limit_table(limits),
        np.array([limits.linear_velocity, limits.linear_acceleration]),
        period,
        *path.held_ends(limits),
        GUARD_TOLERANCE,
        *OFF_GRID[trajectory.continuity],
        0.0 if is_smooth else _LARGEST_STEP,
        has_one_shape,
        everywhere,
        first,
        least,
        most,
    )
    return Pace(*found)


def evenly_paced(
    path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    intervals: int,
    longest: float = LONGEST,
) -> KeyframePath | None:
    """Return a path in the shortest time at its own pace that keeps the limits, in whole periods.

    Args:
        intervals: between the keyframes that it passes.
        longest: that it may take, s.

    Returns:
        ``None`` where no duration keeps the limits.
    """
    reserved = limits.with_reserve()
    guess = path.duration * pace_of(path, reserved, period).coarse
    refusal.check_duration(guess)
    # Two steps of the acceleration within a difference of the setpoints would add up.
    least = 1 if path.trajectory.continuity >= 2 else _CYCLES_A_STEP * intervals
    first, most = math.ceil(guess / period), int(longest / period)
    if guess > longest or most < least:
        return None
    cycles = pace_of(path, reserved, period, first=first, least=least, most=most).cycles
    return path.slowed(cycles * period) if cycles else None


def evenly_made(
    make: Callable[[float], KeyframePath],
    guess: float,
    limits: Limits,
    period: float,
    *,
    longest: float = LONGEST,
) -> KeyframePath | None:
    """Return the shortest path at its own pace that keeps the limits, of those of any duration.

    A curve that begins or ends in motion swings out further the longer it takes: then its rates
    have a least at some duration, beyond which nothing is looked for, and no step is a long one.

    Args:
        make: makes the path that takes a duration, s.
        guess: a first duration, s.
        longest: that it may take, s.

    Returns:
        ``None`` where no duration was found.
    """
    reserved, known = limits.with_reserve(), math.ceil(guess / period)
    coarse = guess * pace_of(make(guess), reserved, period, has_one_shape=False).coarse
    # There is a curve of the first guess; a longer one may swing out further.
    first = math.ceil(coarse / period) if coarse <= 2 * known * period else known
    kept: dict[int, KeyframePath] = {}

    def attempt(cycles: int) -> float:
        path = make(cycles * period)
        factor = pace_of(
            path, reserved, period, first=cycles, least=cycles, most=cycles, has_one_shape=False
        ).factor
        if factor <= 1.0:
            kept[cycles] = path
        return factor

    found = shortest(attempt, first, most=min(int(longest / period), _LONGEST_SEARCH * known))
    return None if found is None else kept[found]


def shortest(attempt: Callable[[int], float], first: int, *, most: int) -> int | None:
    """Return the fewest cycles that keep the limits, to 0.1 %, of curves that change with them.

    Args:
        attempt: plans with a number of cycles and returns by which factor it should be longer; at
            most 1 keeps the limits.
        first: where to begin.
        most: cycles not to go beyond.

    Returns:
        The number of cycles, for which *attempt* has returned at most 1; ``None`` if nothing was
        found.
    """
    low, high, cycles = 0, most + 1, min(first, most)
    tried: dict[int, float] = {}
    for count in range(_MOST_ATTEMPTS):
        factor = attempt(cycles)
        tried[cycles] = min(max(factor, _LEAST), _GREATEST)
        if factor <= 1.0:
            high = cycles
        elif high > most and (_is_rising(tried) or (not count and factor > _FAR < cycles)):
            # It swings out, perhaps: fewer would tell.
            least = min(tried)
            if tried[least] > min(tried.values()) or least == 1:
                return None
            cycles = int(least / _DOWNWARD)
            continue
        else:
            low = max(low, cycles)
        if 1.0 - PRECISION <= factor <= 1.0 or high - low <= max(1.0, PRECISION * high):
            break
        guess = math.exp(_secant([(math.log(n), math.log(f)) for n, f in tried.items()][-2:]))
        if high > most:
            # Nothing has worked yet: no ever smaller steps, and no long ones.
            guess = min(max(guess, cycles * _GROWTH ** max(count - 3, 0)), _LONGEST_STRIDE * cycles)
        elif count >= _MOST_PREDICTIONS or not low < guess < high:
            guess = math.sqrt(max(low, 1) * high)
        cycles = min(max(math.ceil(guess), low + 1), high - 1)
    return high if high <= most else None


def _is_rising(tried: dict[int, float]) -> bool:
    """Return whether more cycles have turned out to be worse."""
    *_, before, here = sorted([(0, math.inf), *tried.items()])
    return here[0] > 1.01 * before[0] and here[1] > 1.001 * before[1]


def _secant(tried: list[tuple[float, float]]) -> float:
    """Return the logarithm of the duration where the factor should be just below 1.

    Where the ends are at rest the factor is inversely proportional to the duration; otherwise it
    falls more slowly, as the last two attempts show.
    """
    *before, here = tried
    slope = -1.0
    if before:
        slope = (here[1] - before[0][1]) / (here[0] - before[0][0])
    return here[0] - (here[1] + 0.5 * PRECISION) / min(max(slope, -1.5), -0.3)
