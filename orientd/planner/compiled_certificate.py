"""What a certificate takes of every record, compiled by Numba.

Imported by :mod:`orientd.planner.fast` only.  The references are
:func:`orientd.planner.differences.differences` and :mod:`orientd.planner.brake`.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import inner
from orientd.planner.compiled_differences import (
    BLOCK,
    BRAKES,
    keep_last,
    new_block,
    put,
    put_sizes,
    put_sizes_about,
    see,
)
from orientd.planner.differences import HISTORY
from orientd.planner.fast import Extremes, LeastRate
from orientd.rotation import Floats


@inner
def _root(rest: float, half: float, leading: float) -> float:
    rest = max(rest, 0.0)
    divisor = half + math.sqrt(half * half + leading * rest)
    return rest / divisor if divisor > 0.0 else math.inf


@inner
def _rate(
    speed: float, size: float, along: float, jerk: float, most: float, most_jerk: float,
    sigma: Floats, g: Floats, fastest: float, margin: float,
) -> float:  # fmt: skip
    """Return the largest safe rate of a point."""
    if size > most or jerk > most_jerk:
        return 0.0
    rate = fastest / margin
    for k in range(len(sigma)):
        square = sigma[k] * sigma[k]
        if most < math.inf:
            rest = most * most - (size * square) ** 2
            rate = min(rate, _root(rest, g[k] * square * along, (g[k] * speed) ** 2))
        if most_jerk < math.inf:
            rest = most_jerk - jerk * square
            rate = min(rate, _root(rest, 1.5 * sigma[k] * g[k] * size, 4.0 * speed))
    return margin * rate


@inner
def _lower_bound(speed: float, size: float, most: float, worst: Floats) -> float:
    """Return a rate that the acceleration allows a point, whatever its directions are."""
    if not most < math.inf:
        return math.inf
    if not size <= most:
        return 0.0
    cells = len(worst) - 1
    root = math.sqrt(1.0 - size / most) * cells
    cell = min(int(root), cells - 1)
    allowed = most * (worst[cell] + (root - cell) * (worst[cell + 1] - worst[cell]))
    return allowed / speed if speed > 0.0 else math.inf


@inner
def _least(
    speed: Floats, size: Floats, along: Floats, jerk: Floats, most: float, most_jerk: float,
    sigma: Floats, g: Floats, worst: Floats, sigma_g: float, fastest: float, margin: float,
    best: float,
) -> tuple[float, int]:  # fmt: skip
    """Return the least rate over all points and which sets it; see :func:`_least_rate`.

    Args:
        speed: sizes of the velocity, shape ``(n,)``.
        size: sizes of the acceleration.
        along: products of velocity and acceleration, without their sign.
        jerk: sizes of the jerk.
        most: as in :func:`_least_rate`, like all that have the same name.
        most_jerk: likewise.
        sigma: likewise.
        g: likewise.
        worst: likewise.
        sigma_g: likewise.
        fastest: likewise.
        margin: likewise.
        best: the least rate of other points, which is returned, with 0, if none is less.
    """
    count, place = len(speed), 0
    # The point nearest to its limit first; most others are ruled out by it.
    bounds = np.empty(count)
    nearest, least = 0, math.inf
    for i in range(count):
        bounds[i] = _lower_bound(speed[i], size[i], most, worst)
        if bounds[i] < least:
            nearest, least = i, bounds[i]
    for turn in range(-1, count):
        i = nearest if turn < 0 else turn
        if i == count:
            break
        limited = jerk[i] + sigma_g * size[i] * best + 4.0 * speed[i] * best * best
        if bounds[i] < best or limited > most_jerk:
            rate = _rate(
                speed[i], size[i], along[i], jerk[i], most, most_jerk, sigma, g, fastest, margin
            )
            if rate < best:
                best, place = rate, i
    return best, place


def _least_rate(
    velocity: Floats, acceleration: Floats, jerk: Floats, most: float, most_jerk: float,
    sigma: Floats, g: Floats, worst: Floats, sigma_g: float, fastest: float, margin: float,
) -> tuple[float, int]:  # fmt: skip
    """Return the least rate over all points and which sets it; see :mod:`orientd.planner.brake`.

    Args:
        velocity: of the path, shape ``(n, k)``.
        acceleration: of the path, shape ``(n, k)``.
        jerk: size of the jerk, shape ``(n,)``.
        most: limit of the acceleration.
        most_jerk: limit of the jerk.
        sigma: rates to look at.
        g: how fast the rate may change there.
        worst: share of the acceleration over the speed that is allowed at roots of the reserve
            from 0 to 1.
        sigma_g: the largest ``3 sigma g``.
        fastest: the largest rate to return.
        margin: to keep.
    """
    count = len(velocity)
    speed, size, along = np.zeros(count), np.zeros(count), np.zeros(count)
    for i in range(count):
        for k in range(velocity.shape[1]):
            speed[i] += velocity[i, k] ** 2
            size[i] += acceleration[i, k] ** 2
            along[i] += velocity[i, k] * acceleration[i, k]
        speed[i], size[i], along[i] = math.sqrt(speed[i]), math.sqrt(size[i]), abs(along[i])
    return _least(
        speed, size, along, jerk, most, most_jerk, sigma, g, worst, sigma_g, fastest, margin,
        fastest,
    )  # fmt: skip


@inner
def slowest(
    block: Floats, count: int, shift: int, with_axes: bool, period: float, start: float,
    rough: Floats, most: Floats, sigma: Floats, g: Floats, worst: Floats, sigma_g: float,
    fastest: float, margin: float, rate: float, place: int,
) -> tuple[float, int]:  # fmt: skip
    """Return the least brake rate of a block, or what it was before, and what sets it.

    Args:
        block: after :func:`orientd.planner.compiled_differences.see`.
        count: how many setpoints there are.
        shift: what to add to a place in the block.
        with_axes: as in :func:`_extremes`, like all that have the same name.
        period: likewise.
        start: likewise.
        rough: likewise.
        most: likewise.
        sigma: likewise.
        g: likewise.
        worst: likewise.
        sigma_g: likewise.
        fastest: likewise.
        margin: likewise.
        rate: the least so far.
        place: what sets that.
    """
    points = count - HISTORY
    if points <= 0:
        return rate, place
    # The norm, then the components where they are limited.
    for column in range(4 if with_axes else 1):
        if column:
            put_sizes_about(block, column - 1, points, period, start + period * shift, rough)
        else:
            put_sizes(block, points, period, start + period * shift, rough)
        rows = block[BRAKES:]
        found, where = _least(
            rows[:points], rows[BLOCK : BLOCK + points], rows[2 * BLOCK : 2 * BLOCK + points],
            rows[3 * BLOCK : 3 * BLOCK + points], most[0, column], most[1, column],
            sigma, g, worst, sigma_g, fastest, margin, rate,
        )  # fmt: skip
        if found < rate:
            rate, place = found, shift + where
    return rate, place


def _extremes(
    q: Floats, past: int, with_axes: bool, period: float, start: float, rough: Floats,
    with_rate: bool, most: Floats, sigma: Floats, g: Floats, worst: Floats,
    sigma_g: float, fastest: float, margin: float, best: float, largest: Floats, places: Indices,
) -> tuple[float, int]:  # fmt: skip
    """Write the largest backward differences, and return the least brake rate and what sets it.

    Args:
        q: setpoints, shape ``(n, 4)``.
        past: how many accelerations, and twice as many velocities, are not to count as largest.
        with_axes: whether the largest components are wanted, too.
        period: from one setpoint to the next, s.
        start: path time of the fourth setpoint, s.
        rough: from when and until when acceleration and jerk may be larger between the records,
            and how many times, shape ``(4,)``.
        with_rate: whether the brake rate is wanted.
        most: limits of acceleration and jerk, of the norm and the components, shape ``(2, 4)``.
        sigma: as in :func:`_least_rate`, like all that have the same name.
        g: likewise.
        worst: likewise.
        sigma_g: likewise.
        fastest: likewise.
        margin: likewise.
        best: the least rate of other records, which is returned, with 0, if none is less.
        largest: receives the largest squares, in units of rad a period, shape ``(3, 4)``; zeros.
        places: receives where these are, shape ``(3, 4)``; zeros.
    """
    block, known, read = new_block(), 0, 0
    rate, place = best, 0
    while read < len(q) or not read:
        count = min(BLOCK, known + len(q) - read)
        for i in range(known, count):
            put(block, i, q[read, 0], q[read, 1], q[read, 2], q[read, 3])
            read += 1
        shift = read - count
        see(block, count, past if not shift else 0, with_axes, shift, largest, places)
        if with_rate:
            rate, place = slowest(
                block, count, shift, with_axes, period, start, rough, most, sigma, g, worst,
                sigma_g, fastest, margin, rate, place,
            )  # fmt: skip
        known = keep_last(block, count)
        if read == len(q):
            break
    return rate, place


_ONE = types.Array(float64, 1, "A", readonly=True)
_TWO = types.Array(float64, 2, "A", readonly=True)
_OUT = float64[:, ::1]
_RATE = types.Tuple((float64, int64))  # type: ignore[no-untyped-call]  # Numba's own

_RATE_SIGNATURE = _RATE(
    _TWO, _TWO, _ONE, float64, float64, _ONE, _ONE, _ONE, float64, float64, float64
)

_EXTREMES_SIGNATURE = _RATE(
    _TWO, int64, boolean, float64, float64, _ONE, boolean, _TWO, _ONE, _ONE, _ONE,
    float64, float64, float64, float64, _OUT, int64[:, ::1],
)  # fmt: skip

extremes: Extremes = cast(
    Extremes, njit(_EXTREMES_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_extremes)
)
least_rate: LeastRate = cast(
    LeastRate, njit(_RATE_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_least_rate)
)
