"""The even timing of a keyframe path: its own pace, slowed down by one factor."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from orientd.model.limits import LONGEST, Limits
from orientd.planner import refusal
from orientd.planner.certify.measuring import measure
from orientd.planner.path import Path
from orientd.planner.timing.axes import NO_AXES, AxisPath
from orientd.planner.timing.keyframe_path import KeyframePath

PRECISION = 1e-3
"""Tolerance of the shortest duration."""

_SPOTS = 32  # in an interval, of the first look
_MOST_LOOKS = 8
_LONGEST_SEARCH = 256  # multiple of the first guess, if the duration changes the curve
_MOST_ATTEMPTS = 40
_LONGEST_STRIDE = 2.0  # ratio of durations if the duration changes the curve
_FAR = 2.0  # factor above which it may not fall with the duration
_DOWNWARD = 1.4
_MOST_PREDICTIONS = 8  # attempts that trust the prediction; then bisection
_GROWTH = 1.05
_LEAST, _GREATEST = 1e-9, 1e4  # factors that a prediction is made from


def excess(path: KeyframePath, limits: Limits, period: float) -> float:
    """Return the factor by which a path should take longer, by the peaks of its certificate."""
    whole, rests = Path(path.trajectory, path.positions), path.held_ends(limits)
    held = np.array([whole.first] * 3), np.array([path.positions.first] * 3)
    count = math.ceil(path.duration / period - 1e-9) + 1
    peaks = measure(whole, count, period, limits, before=held if rests[0] else None, rests=rests)
    velocity, acceleration, jerk = peaks.drawn
    # The part of a third difference that an acceleration step adds falls with the square only.
    is_step = jerk > 1.0 and path.trajectory.continuity < 2
    return max(
        velocity,
        math.sqrt(acceleration),
        math.sqrt(jerk) if is_step else math.cbrt(jerk),
        peaks.linear_velocity.ratio,
        math.sqrt(peaks.linear_acceleration.ratio),
        _LEAST,
    )


def evenly_paced(
    path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    intervals: int,
    longest: float = LONGEST,
    axes: AxisPath = NO_AXES,
) -> KeyframePath | None:
    """Return a path in the shortest time at its own pace that keeps the limits, in whole periods.

    Args:
        intervals: between its keyframes.
        longest: longest duration, s.
        axes: of the device, along the path.

    Returns:
        ``None`` if no duration keeps the limits.
    """
    reserved, kept = limits.with_reserve(), None
    spread = max(period, path.duration / (_SPOTS * intervals))
    least = path.duration * axes.excess(period)
    duration = max(path.duration * excess(path, reserved, spread), least)
    refusal.check_duration(duration)
    cycles, fewest = max(math.ceil(duration / period), 1), 0
    for _ in range(_MOST_LOOKS):
        if cycles * period > longest:
            break
        found = path.slowed(cycles * period)
        factor = max(excess(found, reserved, period), least / found.duration)
        if factor <= 1.0:
            kept = found
        else:
            fewest = cycles
        wanted = max(math.ceil(cycles * factor * (1.0 + 0.4 * PRECISION)), fewest + 1)
        if kept is not None:
            most = round(kept.duration / period)
            if 1.0 - PRECISION < factor <= 1.0 or most - fewest <= max(1, PRECISION * most):
                break
            if wanted >= most:
                wanted = (fewest + most) // 2
        cycles = wanted
    return kept


def evenly_made(
    make: Callable[[float], KeyframePath],
    guess: float,
    limits: Limits,
    period: float,
    *,
    longest: float = LONGEST,
) -> KeyframePath | None:
    """Return the shortest path at its own pace that keeps the limits, over all durations.

    A curve with a moving end swings out further the longer it takes.  Its rates therefore have a
    minimum at some duration.  The search does not go beyond that, and takes no long steps.

    Args:
        make: makes the path of a duration, s.
        guess: a first duration, s.
        longest: longest duration, s.

    Returns:
        ``None`` if no duration was found.
    """
    reserved, known = limits.with_reserve(), math.ceil(guess / period)
    coarse = guess * excess(make(guess), reserved, period)
    # The first guess has a curve; a longer one may swing out further.
    first = math.ceil(coarse / period) if coarse <= 2 * known * period else known
    kept: dict[int, KeyframePath] = {}

    def attempt(cycles: int) -> float:
        path = make(cycles * period)
        factor = excess(path, reserved, period)
        if factor <= 1.0:
            kept[cycles] = path
        return factor

    found = shortest(attempt, first, most=min(int(longest / period), _LONGEST_SEARCH * known))
    return None if found is None else kept[found]


def shortest(attempt: Callable[[int], float], first: int, *, most: int) -> int | None:
    """Return the fewest cycles that keep the limits, to 0.1 %, of curves that change with them.

    Args:
        attempt: plans with a number of cycles and returns the factor by which it should be longer;
            at most 1 keeps the limits.
        first: initial number of cycles.
        most: largest number of cycles.

    Returns:
        The number of cycles, for which *attempt* has returned at most 1; ``None`` if none was
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
            # It may swing out; fewer cycles would show.
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
            # Nothing has worked yet: neither shrink the steps further nor make long ones.
            guess = min(max(guess, cycles * _GROWTH ** max(count - 3, 0)), _LONGEST_STRIDE * cycles)
        elif count >= _MOST_PREDICTIONS or not low < guess < high:
            guess = math.sqrt(max(low, 1) * high)
        cycles = min(max(math.ceil(guess), low + 1), high - 1)
    return high if high <= most else None


def _is_rising(tried: dict[int, float]) -> bool:
    """Return whether more cycles have proved worse."""
    *_, before, here = sorted([(0, math.inf), *tried.items()])
    return here[0] > 1.01 * before[0] and here[1] > 1.001 * before[1]


def _secant(tried: list[tuple[float, float]]) -> float:
    """Return the logarithm of the duration at which the factor should be just below 1.

    If the ends are at rest, the factor is inversely proportional to the duration.  Otherwise it
    falls more slowly; the last two attempts give the slope.
    """
    *before, here = tried
    slope = -1.0
    if before:
        slope = (here[1] - before[0][1]) / (here[0] - before[0][0])
    return here[0] - (here[1] + 0.5 * PRECISION) / min(max(slope, -1.5), -0.3)
