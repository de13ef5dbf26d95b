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
# Of durations that change the curve: the longest ratio of two, and of the last to the first.
_LONGEST_STRIDE, _FARTHEST = 2.0, 16.0
_LEAST_POWER = 0.3  # of the duration, with which such a curve's peaks fall at least
_LEAST = 1e-9


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
    axes: AxisPath = NO_AXES,
) -> KeyframePath | None:
    """Return a path in the shortest time at its own pace that keeps the limits, in whole periods.

    Args:
        intervals: between its keyframes.
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
        if cycles * period > LONGEST:
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
    axes_along: Callable[[KeyframePath], AxisPath],
) -> tuple[KeyframePath, AxisPath] | None:
    """Return a path at its own pace that keeps the limits, whose duration changes the curve.

    Args:
        make: makes the path of a duration, s.
        guess: a first duration, s.
        axes_along: returns the axes of the device along a path.

    Returns:
        The path and the axes along it; ``None`` if no duration was found.

    Raises:
        PlanError: the axes cannot go along one of the paths, at whatever pace.
    """
    cycles, power, tried = math.ceil(guess / period), 1.0, (0.0, 0.0)
    longest = _FARTHEST * cycles
    for look in range(_MOST_LOOKS):
        path = make(cycles * period)
        axes = axes_along(path)
        longer = max(excess(path, limits.with_reserve(), period), axes.excess(period))
        if longer <= 1.0:
            return path, axes
        here = math.log(cycles), math.log(longer)
        if look:
            power = min(max((tried[1] - here[1]) / (here[0] - tried[0]), _LEAST_POWER), 1.0)
        stride = min((longer * (1.0 + 0.4 * PRECISION)) ** (1.0 / power), _LONGEST_STRIDE)
        tried, cycles = here, max(math.ceil(cycles * stride), cycles + 1)
        if cycles > longest:
            break
    return None
