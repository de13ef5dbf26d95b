"""The default curve through keyframes without times, as quick as its limits permit, by Numba.

Imported by :mod:`orientd.planner.fast` only.  The references are
:func:`orientd.planner.timing.chord_knots` and :func:`orientd.planner.timing.shortest`, for a curve
from rest to rest, whose shape is the same at any duration.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import float64, int64, njit, types

from orientd.curves.compiled import fill
from orientd.curves.compiled_interpolation import interpolate
from orientd.curves.compiled_rotation import angle, inner, quaternion
from orientd.planner.compiled_survey import look, survey
from orientd.planner.fast import QuickCore
from orientd.planner.survey import PIECES, SHARES
from orientd.planner.timing import (
    LARGEST_FACTOR,
    MOST_ATTEMPTS,
    MOST_FAILURES,
    MOST_PREDICTIONS,
    PATIENCE,
    PRECISION,
    SAME,
    SMALLEST_FACTOR,
)
from orientd.rotation import Floats


@inner
def _put_chords(keys: Floats, times: Floats) -> float:
    """Write the angles from the first keyframe on, and return the least from one to the next."""
    least = math.inf
    times[0] = 0.0
    for i in range(len(keys) - 1):
        step = angle(quaternion(keys, i), quaternion(keys, i + 1))
        times[i + 1] = times[i] + step
        least = min(least, step)
    return least


@inner
def _first_guess(length: float, count: int, limits: Floats) -> float:
    """Return about how long the motion takes, s; see :meth:`orientd.planner.timing.Knots`."""
    step = length / count
    guess: float = max(
        1.2 * length / limits[0, 0],
        count * math.sqrt(3.0 * step / limits[1, 0]),
        count * math.pow(12.0 * step / limits[2, 0], 1.0 / 3.0),
    )
    return guess


@inner
def _step(before: tuple[float, float], here: tuple[float, float]) -> float:
    """Return the logarithm of the duration where the factor should be just below 1."""
    slope = -1.0
    if abs(here[0] - before[0]) > 1e-9:
        slope = (here[1] - before[1]) / (here[0] - before[0])
    return here[0] - (here[1] + 0.5 * PRECISION) / min(max(slope, -1.5), -0.3)


def _quick_core(
    keys: Floats, limits: Floats, period: float, most: int, times: Floats, breaks: Floats,
    table: Floats, solved: Floats, at_ends: Floats,
) -> tuple[int, float]:  # fmt: skip
    """Write the curve through keyframes, and return how many cycles it should take.

    Args:
        keys: the keyframes, shape ``(n, 4)``.
        limits: to keep: of the norm and the components, shape ``(3, 4)``.
        period: of the device, s.
        most: cycles not to go beyond.
        times: receives the times of the keyframes in the curve, s, shape ``(n,)``.
        breaks: as in :mod:`orientd.curves.compiled_interpolation`, shape ``(n + 2,)``.
        table: likewise.
        solved: likewise.
        at_ends: receives samples at both ends, shape ``(10, 2)``.

    Returns:
        The fewest cycles that keep the limits, to 0.1 %, or 0 if they were not found this way; and
        how long the curve itself takes, s.
    """
    count = len(keys) - 1
    if not _put_chords(keys, times) > SAME:
        return 0, 0.0
    length = times[count]
    duration = max(_first_guess(length, count, limits), 2.0 * period)
    for i in range(count + 1):
        times[i] = times[i] / length * duration
    times[count] = duration
    if not interpolate(keys, False, times, np.zeros((2, 2, 3)), 2, 2, breaks, table, solved):
        return 0, 0.0
    spots = np.empty((len(SHARES) * (len(breaks) + PIECES) + 2, 2))
    expected, found = survey(breaks, table, 1.0, duration, period, limits, False, spots)
    spots = spots[:found]

    low, high = 0, most + 1
    cycles = min(max(math.ceil(duration * expected / period), 1), most)
    growth, before = 1.02, (0.0, 0.0)
    for attempt in range(MOST_ATTEMPTS):
        total = cycles * period
        final = round(total / period)
        factor = look(
            spots, final, breaks, table, duration / total, total, period, limits, True, True
        )
        if factor <= 1.0:
            high = cycles
            if factor >= 1.0 - PRECISION:
                break
        else:
            low = max(low, cycles)
        if high - low <= max(1.0, PRECISION * high):
            break
        here = math.log(cycles), math.log(min(max(factor, SMALLEST_FACTOR), LARGEST_FACTOR))
        guess = math.exp(_step(before if attempt else here, here))
        before = here
        if high > most:
            if attempt >= MOST_FAILURES:
                break
            if attempt >= PATIENCE:
                # Nothing has worked yet: no ever smaller steps.
                guess, growth = max(guess, cycles * growth), min(growth * growth, 2.0)
        elif attempt >= MOST_PREDICTIONS or not low < guess < high:
            guess = math.sqrt(float(low) * high) if low else 0.5 * high
        cycles = min(max(math.ceil(guess), low + 1), high - 1)
    instants = np.empty(2)
    instants[0], instants[1] = breaks[0], breaks[-1]
    fill(instants, breaks, table, 0.0, at_ends)
    return (high if high <= most else 0), duration


_TWO = types.Array(float64, 2, "C", readonly=True)
_FOUND = types.Tuple((int64, float64))  # type: ignore[no-untyped-call]  # Numba's own

quick_core: QuickCore = cast(
    QuickCore,
    njit(
        _FOUND(
            _TWO, _TWO, float64, int64, float64[::1], float64[::1],
            float64[:, ::1], float64[:, ::1], float64[:, ::1],
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_quick_core),
)  # fmt: skip
