"""What joins of two states of motion ask of a device, one by one, compiled by Numba.

Imported by :mod:`orientd.planner.fast` and compiled kernels only.  The reference is
:mod:`orientd.planner.quintic`.  A state is a row of ten numbers: orientation, angular velocity and
angular acceleration.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import float64, njit, types, void

from orientd.curves.compiled_lanes import Quaternion, Vector
from orientd.curves.compiled_product import fill
from orientd.curves.compiled_rotation import (
    conjugated,
    exponential,
    inner,
    joined,
    logarithm,
    multiplied,
    turned,
)
from orientd.planner.fast import PutJoins
from orientd.rotation import Floats


@inner
def three(row: Floats, begin: int) -> Vector:
    """Return three numbers of a row as a vector."""
    return row[begin], row[begin + 1], row[begin + 2]


@inner
def orientation(state: Floats) -> Quaternion:
    """Return the orientation of a state."""
    return state[0], state[1], state[2], state[3]


@inner
def _put(w: Floats, k: int, v: Vector) -> None:
    w[k, 0], w[k, 1], w[k, 2] = v


@inner
def weighted_sum(v: Vector, factor: float, other: Vector, share: float) -> Vector:
    """Return ``factor * v + share * other``."""
    return (
        factor * v[0] + share * other[0],
        factor * v[1] + share * other[1],
        factor * v[2] + share * other[2],
    )


@inner
def increments(start: Floats, end: Floats, h: float, w: Floats) -> Quaternion:
    """Write the increments of a join but the middle one, and return the quaternion of that.

    Of the two ways round, it is that of the shorter one.

    Args:
        start: orientation, velocity and acceleration it begins with, shape ``(10,)``.
        end: the same where it ends.
        h: how long it takes, s.
        w: receives the increments, shape ``(5, 3)``.
    """
    omega, alpha = three(start, 4), three(start, 7)
    other_omega, other_alpha = three(end, 4), three(end, 7)
    bend = h * h / 40.0
    _put(w, 0, weighted_sum(omega, h / 10.0, alpha, 0.0))
    _put(w, 1, weighted_sum(omega, h / 10.0, alpha, bend))
    _put(w, 4, weighted_sum(other_omega, h / 10.0, other_alpha, 0.0))
    last = exponential(w[4, 0], w[4, 1], w[4, 2])
    _put(w, 3, turned(last, weighted_sum(other_omega, h / 10.0, other_alpha, -bend)))
    begun = multiplied(
        orientation(start),
        multiplied(exponential(w[0, 0], w[0, 1], w[0, 2]), exponential(w[1, 0], w[1, 1], w[1, 2])),
    )
    ended = multiplied(exponential(w[3, 0], w[3, 1], w[3, 2]), last)
    middle = multiplied(conjugated(begun), multiplied(orientation(end), conjugated(ended)))
    if middle[0] < 0.0:
        return -middle[0], -middle[1], -middle[2], -middle[3]
    return middle


@inner
def put_middle(w: Floats, middle: Quaternion, way: int) -> None:
    """Write the middle increment of a join, for one of the two ways round."""
    sign = 1.0 - 2.0 * way
    a, b, c, d = middle
    _put(w, 2, logarithm((sign * a, sign * b, sign * c, sign * d)))


@inner
def _peak(squares: Floats, count: int) -> float:
    """Return the largest of some values, by a parabola where it lies between them."""
    at = 0
    for i in range(1, count):
        if squares[i] > squares[at]:
            at = i
    largest: float = squares[at]
    at = min(max(at, 1), count - 2)
    before, here, after = squares[at - 1], squares[at], squares[at + 1]
    bend = 2.0 * here - before - after
    if here >= before and here >= after and bend > 0.0:
        top: float = here + (after - before) ** 2 / (8.0 * bend)
        return max(largest, top)
    return largest


@inner
def exceeds(v: Vector, scale: float, most: Floats) -> bool:
    """Return whether a vector times *scale* is above its bounds: the norm, then the components."""
    exceeds = False
    for i in range(1, len(most)):
        exceeds |= not abs(v[i - 1]) * scale <= most[i]
    return exceeds


@inner
def seems_to_keep(w: Floats, duration: float, to_rates: Floats, most: Floats) -> bool:
    """Return whether a join keeps its bounds as if turns commuted."""
    points = to_rates.shape[1]
    squares = np.empty(points)
    rate = 1.0 / duration
    # Ways that are too short mostly ask for too much acceleration.
    for order, scale in ((1, rate * rate), (0, rate), (2, rate * rate * rate)):
        for p in range(points):
            x, y, z = 0.0, 0.0, 0.0
            for k in range(5):
                share = to_rates[order, p, k]
                x += share * w[k, 0]
                y += share * w[k, 1]
                z += share * w[k, 2]
            squares[p] = x * x + y * y + z * z
            if not math.sqrt(squares[p]) * scale <= most[order, 0]:
                return False
            if exceeds((x, y, z), scale, most[order]):
                return False
        if not math.sqrt(_peak(squares, points)) * scale <= most[order, 0]:
            return False
    return True


@inner
def keeps(w: Floats, duration: float, at_points: Floats, most: Floats, squares: Floats) -> bool:
    """Return whether a join keeps its bounds at some points of the curve itself."""
    points = at_points.shape[2]
    lengths, axes = np.empty(5), np.empty((5, 3))
    for k in range(5):
        length = math.sqrt(w[k, 0] ** 2 + w[k, 1] ** 2 + w[k, 2] ** 2)
        lengths[k] = length
        for i in range(3):
            axes[k, i] = w[k, i] / length if length > 0.0 else w[k, i]
    rate = 1.0 / duration
    before = (0.0, 0.0, 0.0)
    for p in range(points):
        motion = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for k in range(5):
            length = lengths[k]
            turn = (
                length * at_points[0, k, p],
                length * at_points[1, k, p] * rate,
                length * at_points[2, k, p] * rate * rate,
            )
            motion = joined(motion, three(axes[k], 0), turn)
        _, omega, alpha = motion
        jerk = weighted_sum(alpha, (points - 1) * rate, before, -(points - 1) * rate)
        before = alpha
        for order, v in enumerate((omega, alpha, jerk)):
            if order == 2 and p == 0:
                continue
            square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
            squares[order, p] = square
            if not math.sqrt(square) <= most[order, 0] or exceeds(v, 1.0, most[order]):
                return False
    for order in range(3):
        first = 1 if order == 2 else 0
        if not math.sqrt(_peak(squares[order, first:], points - first)) <= most[order, 0]:
            return False
    return True


def _put_joins(
    q: Floats, w: Floats, breaks: Floats, unit_values: Floats, unit_rates: Floats,
    unit_curvatures: Floats, base: Floats, axes: Floats, lengths: Floats, values: Floats,
    rates: Floats, curvatures: Floats, at_ends: Floats,
) -> None:  # fmt: skip
    """Write what joins end to end are sampled from; see :class:`orientd.planner.quintic.Joins`.

    Args:
        q: orientations that they begin at, shape ``(n, 4)``.
        w: their increments, shape ``(n, 5, 3)``.
        breaks: when they begin, and when the last one ends, s, shape ``(n + 1,)``.
        unit_values: coefficients of the basis functions over a second, shape ``(5, 6)``.
        unit_rates: those of their derivatives, shape ``(5, 5)``.
        unit_curvatures: those of their second derivatives, shape ``(5, 4)``.
        base: receives the orientations, shape ``(4, n)``.
        axes: receives the unit axes of the increments, shape ``(5, 3, n)``.
        lengths: receives their half angles, shape ``(5, n)``.
        values: receives the coefficients of each join, shape ``(n, 5, 6)``.
        rates: likewise, shape ``(n, 5, 5)``.
        curvatures: likewise, shape ``(n, 5, 4)``.
        at_ends: receives samples at both ends, shape ``(10, 2)``.
    """
    for i in range(len(q)):
        rate = 1.0 / (breaks[i + 1] - breaks[i])
        for k in range(4):
            base[k, i] = q[i, k]
        for k in range(5):
            length = math.sqrt(w[i, k, 0] ** 2 + w[i, k, 1] ** 2 + w[i, k, 2] ** 2)
            lengths[k, i] = length
            for c in range(3):
                # A factor that does not turn has any axis.
                axes[k, c, i] = w[i, k, c] / length if length > 0.0 else 0.0
            for j in range(6):
                values[i, k, j] = unit_values[k, j]
            for j in range(5):
                rates[i, k, j] = rate * unit_rates[k, j]
            for j in range(4):
                curvatures[i, k, j] = rate * rate * unit_curvatures[k, j]
    instants = np.empty(2)
    instants[0], instants[1] = breaks[0], breaks[-1]
    fill(instants, breaks, base, axes, lengths, values, rates, curvatures, 0.0, at_ends)


_ONE, _TWO, _THREE = (types.Array(float64, n, "C", readonly=True) for n in (1, 2, 3))

_ROWS = types.Array(float64, 2, "A", readonly=True)

put_joins: PutJoins = cast(
    PutJoins,
    njit(
        void(
            _ROWS, _THREE, _ONE, _TWO, _TWO, _TWO, float64[:, ::1], float64[:, :, ::1],
            float64[:, ::1], float64[:, :, ::1], float64[:, :, ::1], float64[:, :, ::1],
            float64[:, ::1],
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_put_joins),
)  # fmt: skip
