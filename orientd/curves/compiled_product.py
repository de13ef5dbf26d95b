"""The cumulative product of any number of factors, compiled by Numba.

Imported by :mod:`orientd.curves.fast` and compiled kernels only.  The formulas are those of
:mod:`orientd.curves.product`, which is the reference.  Curves of at most three cubic factors have
:mod:`orientd.curves.compiled`, which is about twice as fast; this one serves the quintic joins of
the planner.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import float64, int64, njit, types, uint64

from orientd.curves.compiled_lanes import (
    cosine_and_sine,
    followed,
    moved,
    turned_back,
    vectorised,
)
from orientd.curves.compiled_rotation import inner
from orientd.curves.fast import FillProduct
from orientd.rotation import Floats

TILE = 64
"""Instants in one span that are worked on at a time, in one row of numbers: so many for each
quantity, one quantity after the other."""

_U, _ANGLE, _RATE, _CURVATURE = (row * TILE for row in range(10, 14))
_WEIGHTS = 14 * TILE


@vectorised
def _raise(block: Floats, row: int, degree: int, count: int) -> None:
    """Replace the Bernstein polynomials of one degree by those of the next, *degree*."""
    for j in range(degree, -1, -1):
        here, below = row + j * TILE, row + (j - 1) * TILE
        if j == degree:
            for i in range(uint64(count)):
                block[here + i] = block[_U + i] * block[below + i]
        elif j:
            for i in range(uint64(count)):
                u = block[_U + i]
                block[here + i] = u * block[below + i] + (1.0 - u) * block[here + i]
        else:
            for i in range(uint64(count)):
                block[here + i] *= 1.0 - block[_U + i]


@inner
def _put_weights(block: Floats, factors: int, count: int) -> tuple[int, int, int]:
    """Write the Bernstein polynomials of three degrees, and return where each begins."""
    low = _WEIGHTS
    middle = low + max(factors - 1, 1) * TILE
    high = middle + factors * TILE
    for i in range(count):
        block[low + i] = 1.0
    for degree in range(1, factors - 1):
        _raise(block, low, degree, count)
    for i in range(max(factors - 1, 1) * TILE):
        block[middle + i] = block[low + i]
    if factors > 1:
        _raise(block, middle, factors - 1, count)
    for i in range(factors * TILE):
        block[high + i] = block[middle + i]
    _raise(block, high, factors, count)
    return low, middle, high


@vectorised
def _weigh(
    block: Floats, row: int, coefficients: Floats, scale: float, target: int, count: int
) -> None:
    """Write the sum of some polynomials, each times its coefficient."""
    for i in range(uint64(count)):
        block[target + i] = 0.0
    for m in range(len(coefficients)):
        share, place = scale * coefficients[m], row + m * TILE
        for i in range(uint64(count)):
            block[target + i] += share * block[place + i]


@vectorised
def _follow(block: Floats, ax: float, ay: float, az: float, count: int) -> None:
    """Have the motions of a tile followed by turns about one axis."""
    for i in range(uint64(count)):
        c, s = cosine_and_sine(block[_ANGLE + i])
        e = (s * ax, s * ay, s * az)
        q = (block[i], block[TILE + i], block[2 * TILE + i], block[3 * TILE + i])
        omega = (block[4 * TILE + i], block[5 * TILE + i], block[6 * TILE + i])
        alpha = (block[7 * TILE + i], block[8 * TILE + i], block[9 * TILE + i])
        q = followed(q, c, e)
        omega, alpha = turned_back(c, e, omega), turned_back(c, e, alpha)
        rate, curvature = 2.0 * block[_RATE + i], 2.0 * block[_CURVATURE + i]
        omega, alpha = moved(omega, alpha, (ax, ay, az), rate, curvature)
        block[i], block[TILE + i] = q[0], q[1]
        block[2 * TILE + i], block[3 * TILE + i] = q[2], q[3]
        block[4 * TILE + i], block[5 * TILE + i], block[6 * TILE + i] = omega
        block[7 * TILE + i], block[8 * TILE + i], block[9 * TILE + i] = alpha


def _fill(
    times: Floats, breaks: Floats, base: Floats, axes: Floats, lengths: Floats,
    values: Floats, rates: Floats, curvatures: Floats, slack: float, out: Floats,
) -> int:  # fmt: skip
    """Write orientation, velocity and acceleration at instants in any order.

    Args:
        times: instants in seconds, shape ``(n,)``.
        breaks: ends of the spans, shape ``(S + 1,)``.
        base: the quaternions before the product of each span, shape ``(4, S)``.
        axes: unit axes of the factors, shape ``(m, 3, S)``.
        lengths: their half angles, shape ``(m, S)``.
        values: Bernstein coefficients of the basis functions, shape ``(S, m, m + 1)``.
        rates: those of their derivatives, shape ``(S, m, m)``.
        curvatures: those of their second derivatives, shape ``(S, m, m - 1)``.
        slack: how far outside the domain an instant may be, in seconds.
        out: receives the samples, shape ``(10, n)``.

    Returns:
        The place of the first instant that is outside the domain, or -1 if none is.
    """
    factors, total = len(lengths), len(times)
    first, last = breaks[0], breaks[-1]
    block = np.empty(_WEIGHTS + 3 * (factors + 1) * TILE)
    i = 0
    while i < total:
        t = times[i]
        if not (first - slack <= t <= last + slack):
            return i
        t = min(max(t, first), last)
        span = min(int(np.searchsorted(breaks, t, side="right")) - 1, len(breaks) - 2)
        start, end = breaks[span], breaks[span + 1]
        # As many as follow in the same span.
        count = 0
        while True:
            block[_U + count] = (t - start) / (end - start)
            count += 1
            if count == TILE or i + count == total:
                break
            t = times[i + count]
            if not start <= t < end:
                break
        low, middle, high = _put_weights(block, factors, count)
        for row in range(10):
            for k in range(count):
                block[row * TILE + k] = base[row, span] if row < 4 else 0.0
        for j in range(factors):
            length = lengths[j, span]
            _weigh(block, high, values[span, j], length, _ANGLE, count)
            _weigh(block, middle, rates[span, j], length, _RATE, count)
            _weigh(block, low, curvatures[span, j], length, _CURVATURE, count)
            _follow(block, axes[j, 0, span], axes[j, 1, span], axes[j, 2, span], count)
        for row in range(10):
            for k in range(count):
                out[row, i + k] = block[row * TILE + k]
        i += count
    return -1


_ONE, _TWO, _THREE = (types.Array(float64, n, "C", readonly=True) for n in (1, 2, 3))
_SIGNATURE = int64(_ONE, _ONE, _TWO, _THREE, _TWO, _THREE, _THREE, _THREE, float64, float64[:, ::1])

fill: FillProduct = cast(
    FillProduct, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_fill)
)
