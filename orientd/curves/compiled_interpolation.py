"""The twice differentiable cumulative cubic B-spline through keyframes, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The reference is :mod:`orientd.curves.c2_cumulative`,
whose steps stand here one after the other, for keyframes without whole turns between them.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_basis import fill as fill_basis
from orientd.curves.compiled_increments import find
from orientd.curves.compiled_rotation import (
    exponential,
    inner,
    logarithm,
    multiplied,
    quaternion,
    relative,
    turned,
)
from orientd.curves.fast import Interpolate
from orientd.rotation import Floats


@inner
def _align(keys: Floats) -> None:
    """Give each keyframe the sign nearer to its predecessor, as :func:`orientd.rotation.align`."""
    for i in range(1, len(keys)):
        cosine = 0.0
        for k in range(4):
            cosine += keys[i, k] * keys[i - 1, k]
        if cosine < 0.0:
            for k in range(4):
                keys[i, k] = -keys[i, k]


@inner
def _put_breaks(
    times: Floats, with_start: bool, with_end: bool, breaks: Floats, places: Indices
) -> None:
    """Write the ends of the spans, and which of them begins at each keyframe."""
    last = len(times) - 1
    place = 0
    for i in range(last):
        breaks[place], places[i] = times[i], place
        place += 1
        if (with_start and i == 0) or (with_end and i == last - 1):
            breaks[place] = 0.5 * (times[i] + times[i + 1])
            place += 1
    breaks[place], places[last] = times[last], place


@inner
def _put_factors(places: Indices, values: Floats, index: Indices, share: Floats) -> None:
    """Write increments and shares of the factors that lead from each keyframe to the next."""
    spans, factors = len(values), index.shape[1]
    for i in range(len(index)):
        here, there = places[i], places[i + 1]
        index[i, 0], share[i, 0] = here + 1, -values[here, 1, 0]
        index[i, 1], share[i, 1] = here, 1.0 - values[here, 0, 0]
        for more in range(1, factors - 3):
            is_passed = here + more < there
            index[i, 1 + more] = here + more if is_passed else here
            share[i, 1 + more] = 1.0 if is_passed else 0.0
        index[i, factors - 2], index[i, factors - 1] = there, there + 1
        share[i, factors - 2] = values[there, 0, 0] if there < spans else 1.0
        share[i, factors - 1] = values[there, 1, 0] if there < spans else 1.0


@inner
def _put_known(given: Floats, rate: float, first: float, second: float, known: Floats) -> None:
    """Write the increments that a velocity, and with it an acceleration, settle at an end.

    Args:
        given: body angular velocity and acceleration, shape ``(2, 3)``.
        rate: derivative of the outermost basis function.
        first: its second derivative.
        second: that of the next one.
        known: receives the increments, the outermost first, shape ``(0..2, 3)``.
    """
    for k in range(3):
        if len(known) > 0:
            known[0, k] = given[0, k] / (2.0 * rate)
        if len(known) > 1:
            known[1, k] = (0.5 * given[1, k] - first * known[0, k]) / second


@inner
def _turn_last(given: Floats, rate: float) -> None:
    """Turn the acceleration at the end: the last factor stands before the one it settles."""
    x, y, z = given[0, 0] / (2.0 * rate), given[0, 1] / (2.0 * rate), given[0, 2] / (2.0 * rate)
    alpha = given[1, 0], given[1, 1], given[1, 2]
    given[1, 0], given[1, 1], given[1, 2] = turned(exponential(x, y, z), alpha)


@inner
def _put_controls(
    places: Indices, keys: Floats, values: Floats, solved: Floats, table: Floats
) -> None:
    """Write the quaternion before the product of each span, each from its keyframe."""
    i = 0
    for span in range(len(values)):
        x, y, z = solved[span, 0], solved[span, 1], solved[span, 2]
        if places[i] == span:
            c = -values[span, 0, 0]
            first = exponential(c * x, c * y, c * z)
            x, y, z = solved[span + 1, 0], solved[span + 1, 1], solved[span + 1, 2]
            c = -values[span, 1, 0]
            q = multiplied(quaternion(keys, i), multiplied(exponential(c * x, c * y, c * z), first))
            i += 1
        else:
            # It begins between keyframes and continues the span before it.
            before = solved[span - 1]
            base = table[0, span - 1], table[1, span - 1], table[2, span - 1], table[3, span - 1]
            q = multiplied(base, exponential(before[0], before[1], before[2]))
        table[0, span], table[1, span], table[2, span], table[3, span] = q


@inner
def _put_table(
    breaks: Floats, values: Floats, rates: Floats, curvatures: Floats, solved: Floats, table: Floats
) -> None:
    """Write the factors of each span: coefficients of the half angle, and the axis."""
    for span in range(len(values)):
        width = breaks[span + 1] - breaks[span]
        for f in range(3):
            x, y, z = solved[span + f, 0], solved[span + f, 1], solved[span + f, 2]
            length = math.sqrt(x * x + y * y + z * z)
            scale = 1.0 / length if length > 0.0 else 1.0
            change = (curvatures[span, f, 1] - curvatures[span, f, 0]) / width
            row = 4 + 7 * f
            table[row, span] = length * values[span, f, 0]
            table[row + 1, span] = length * rates[span, f, 0]
            table[row + 2, span] = length * curvatures[span, f, 0] / 2.0
            table[row + 3, span] = length * change / 6.0
            table[row + 4, span] = scale * x
            table[row + 5, span] = scale * y
            table[row + 6, span] = scale * z


def _interpolate(
    keyframes: Floats, is_aligned: bool, times: Floats, given: Floats,
    start_known: int, end_known: int, breaks: Floats, table: Floats, solved: Floats,
) -> bool:  # fmt: skip
    """Write the spline through keyframes, or return that it was not found at once.

    Args:
        keyframes: unit quaternions, shape ``(n, 4)``.
        is_aligned: whether they are to be taken with the signs they have.
        times: of the keyframes, increasing, s, shape ``(n,)``.
        given: angular velocity and acceleration at the first keyframe and at the last, body
            frame, shape ``(2, 2, 3)``.
        start_known: how much of that is a condition at the first keyframe: 0 to 2.
        end_known: likewise at the last one; not 2 at both ends of two keyframes.
        breaks: receives the ends of the spans, one more for each end with two conditions,
            shape ``(S + 1,)``.
        table: receives what the spline is sampled from, shape ``(25, S)``.
        solved: receives the increments, shape ``(S + 2, 3)``.
    """
    keys = keyframes.copy()
    if not is_aligned:
        _align(keys)
    count, spans = len(keys), len(breaks) - 1
    steps = np.empty((count - 1, 3))
    for i in range(count - 1):
        step = logarithm(relative(quaternion(keys, i), quaternion(keys, i + 1)))
        steps[i, 0], steps[i, 1], steps[i, 2] = step
    places = np.empty(count, dtype=np.int64)
    _put_breaks(times, start_known == 2, end_known == 2, breaks, places)
    knots = np.empty(spans + 7)
    for i in range(len(knots)):
        knots[i] = breaks[min(max(i - 3, 0), spans)]
    values, rates = np.empty((spans, 3, 4)), np.empty((spans, 3, 3))
    curvatures = np.empty((spans, 3, 2))
    of_spans = np.empty(spans, dtype=np.int64)
    for i in range(spans):
        of_spans[i] = i + 3
    fill_basis(of_spans, knots, 4, values, rates, curvatures)
    passed = 1
    for i in range(count - 1):
        passed = max(passed, places[i + 1] - places[i])
    index, share = (
        np.empty((count - 1, passed + 3), dtype=np.int64),
        np.empty((count - 1, passed + 3)),
    )
    _put_factors(places, values, index, share)

    heads, tails = np.empty((start_known, 3)), np.empty((end_known, 3))
    first, second = curvatures[0, 0, 0], curvatures[0, 1, 0]
    _put_known(given[0], rates[0, 0, 0], first, second, heads)
    start_ratio = -second / first
    end = given[1].copy()
    _turn_last(end, rates[-1, 2, -1])
    first, second = curvatures[-1, 2, -1], curvatures[-1, 1, -1]
    _put_known(end, rates[-1, 2, -1], first, second, tails)
    end_ratio = -second / first

    unknown = np.empty((count - 1, 3))
    if not find(index, share, steps, heads, tails, start_ratio, end_ratio, unknown):
        return False
    begin, last = max(1, start_known), spans + 1
    for k in range(3):
        solved[0, k], solved[last, k] = start_ratio * unknown[0, k], end_ratio * unknown[-1, k]
        for i in range(count - 1):
            solved[begin + i, k] = unknown[i, k]
        for i in range(start_known):
            solved[i, k] = heads[i, k]
        for i in range(end_known):
            solved[last - i, k] = tails[i, k]
    _put_controls(places, keys, values, solved, table)
    _put_table(breaks, values, rates, curvatures, solved, table)
    return True


_ONE, _TWO, _THREE = (types.Array(float64, n, "C", readonly=True) for n in (1, 2, 3))

interpolate: Interpolate = cast(
    Interpolate,
    njit(
        boolean(
            _TWO, boolean, _ONE, _THREE, int64, int64,
            float64[::1], float64[:, ::1], float64[:, ::1],
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_interpolate),
)  # fmt: skip
