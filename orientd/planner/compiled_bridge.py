"""The search for the shortest bridge, compiled by Numba.

Imported by :mod:`orientd.planner.fast` only.  The formulas are those of
:mod:`orientd.planner.quintic`, which is the reference; here every candidate is given up at the
first point where it exceeds its bounds.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types, void

from orientd.curves.basis import Indices
from orientd.curves.compiled_product import joined
from orientd.curves.compiled_rotation import (
    Quaternion,
    Vector,
    conjugated,
    exponential,
    inner,
    logarithm,
    multiplied,
    turned,
)
from orientd.planner.fast import Booleans, Join, Look, Measure, Turn
from orientd.rotation import Floats


@inner
def _row3(rows: Floats, i: int) -> Vector:
    return rows[i, 0], rows[i, 1], rows[i, 2]


@inner
def _row4(rows: Floats, i: int) -> Quaternion:
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@inner
def _put(w: Floats, k: int, v: Vector) -> None:
    w[k, 0], w[k, 1], w[k, 2] = v


@inner
def _sum(v: Vector, factor: float, other: Vector, share: float) -> Vector:
    return (
        factor * v[0] + share * other[0],
        factor * v[1] + share * other[1],
        factor * v[2] + share * other[2],
    )


@inner
def _increments(
    q: Quaternion, omega: Vector, alpha: Vector,
    other_q: Quaternion, other_omega: Vector, other_alpha: Vector, h: float, w: Floats,
) -> Quaternion:  # fmt: skip
    """Write the increments of a join but the middle one, and return the quaternion of that.

    Of the two ways round, it is that of the shorter one.
    """
    bend = h * h / 40.0
    _put(w, 0, _sum(omega, h / 10.0, alpha, 0.0))
    _put(w, 1, _sum(omega, h / 10.0, alpha, bend))
    _put(w, 4, _sum(other_omega, h / 10.0, other_alpha, 0.0))
    last = exponential(w[4, 0], w[4, 1], w[4, 2])
    _put(w, 3, turned(last, _sum(other_omega, h / 10.0, other_alpha, -bend)))
    begun = multiplied(
        q,
        multiplied(exponential(w[0, 0], w[0, 1], w[0, 2]), exponential(w[1, 0], w[1, 1], w[1, 2])),
    )
    ended = multiplied(exponential(w[3, 0], w[3, 1], w[3, 2]), last)
    middle = multiplied(conjugated(begun), multiplied(other_q, conjugated(ended)))
    if middle[0] < 0.0:
        return -middle[0], -middle[1], -middle[2], -middle[3]
    return middle


@inner
def _put_middle(w: Floats, middle: Quaternion, way: int) -> None:
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
def _exceeds(v: Vector, scale: float, most: Floats) -> bool:
    """Return whether a vector times *scale* is above its bounds: the norm, then the components."""
    exceeds = False
    for i in range(1, len(most)):
        exceeds |= not abs(v[i - 1]) * scale <= most[i]
    return exceeds


@inner
def _seems_to_keep(w: Floats, duration: float, to_rates: Floats, most: Floats) -> bool:
    """Return whether a join keeps its bounds as if turns commuted."""
    points = to_rates.shape[1]
    squares = np.empty(points)
    scale = 1.0
    for order in range(3):
        scale /= duration
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
            if _exceeds((x, y, z), scale, most[order]):
                return False
        if not math.sqrt(_peak(squares, points)) * scale <= most[order, 0]:
            return False
    return True


def _look(
    q: Floats, omega: Floats, alpha: Floats,
    other_q: Floats, other_omega: Floats, other_alpha: Floats,
    pairs: Indices, durations: Floats, to_rates: Floats, most: Floats, kept: Booleans,
) -> None:  # fmt: skip
    """Write which joins seem to keep the bounds, both ways round each.

    Args:
        q: orientations they begin at, one for every pair of ramps, shape ``(p, 4)``.
        omega: velocities there, shape ``(p, 3)``.
        alpha: accelerations there.
        other_q: the same where they end.
        other_omega: likewise.
        other_alpha: likewise.
        pairs: the pair of ramps of each, shape ``(n,)``.
        durations: s, shape ``(n,)``.
        to_rates: what turns increments to rates, shape ``(3, points, 5)``.
        most: the bounds, shape ``(3, 1 or 4)``.
        kept: receives the answers, shape ``(2, n)``.
    """
    w = np.empty((5, 3))
    for i in range(len(pairs)):
        k, h = pairs[i], durations[i]
        middle = _increments(
            _row4(q, k), _row3(omega, k), _row3(alpha, k),
            _row4(other_q, k), _row3(other_omega, k), _row3(other_alpha, k), h, w,
        )  # fmt: skip
        for way in range(2):
            _put_middle(w, middle, way)
            kept[way, i] = _seems_to_keep(w, h, to_rates, most)


@inner
def _keeps(w: Floats, duration: float, at_points: Floats, most: Floats, squares: Floats) -> bool:
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
            motion = joined(motion, _row3(axes, k), turn)
        _, omega, alpha = motion
        jerk = _sum(alpha, (points - 1) * rate, before, -(points - 1) * rate)
        before = alpha
        for order, v in enumerate((omega, alpha, jerk)):
            if order == 2 and p == 0:
                continue
            square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
            squares[order, p] = square
            if not math.sqrt(square) <= most[order, 0] or _exceeds(v, 1.0, most[order]):
                return False
    for order in range(3):
        first = 1 if order == 2 else 0
        if not math.sqrt(_peak(squares[order, first:], points - first)) <= most[order, 0]:
            return False
    return True


def _measure(
    q: Floats, omega: Floats, alpha: Floats,
    other_q: Floats, other_omega: Floats, other_alpha: Floats,
    pairs: Indices, ways: Indices, durations: Floats, at_points: Floats, most: Floats, w: Floats,
) -> int:  # fmt: skip
    """Return the first join that keeps the bounds on the curve itself, and write its increments.

    Args:
        q: as in :func:`_look`, like all that have the same name.
        omega: likewise.
        alpha: likewise.
        other_q: likewise.
        other_omega: likewise.
        other_alpha: likewise.
        pairs: likewise.
        ways: the way round of each, shape ``(n,)``.
        durations: likewise.
        at_points: basis functions with two derivatives, shape ``(3, 5, points)``.
        most: likewise.
        w: receives the increments, shape ``(5, 3)``.

    Returns:
        Its index, or -1 if there is none.
    """
    squares = np.empty((3, at_points.shape[2]))
    for i in range(len(pairs)):
        k, h = pairs[i], durations[i]
        middle = _increments(
            _row4(q, k), _row3(omega, k), _row3(alpha, k),
            _row4(other_q, k), _row3(other_omega, k), _row3(other_alpha, k), h, w,
        )  # fmt: skip
        _put_middle(w, middle, ways[i])
        if _keeps(w, h, at_points, most, squares):
            return i
    return -1


def _turn(
    q: Floats, omega: Floats, alpha: Floats, goals: Floats, durations: Floats, substeps: int,
    ends: Floats,
) -> None:  # fmt: skip
    """Write where ramps of the acceleration lead to; see :func:`orientd.planner.bridge.turned`.

    Args:
        q: orientation they begin at, shape ``(4,)``.
        omega: velocity there, shape ``(3,)``.
        alpha: acceleration there.
        goals: accelerations they lead to, shape ``(n, 3)``.
        durations: s, shape ``(n,)``.
        substeps: of the expansion.
        ends: receives the orientations, shape ``(n, 4)``.
    """
    begin = (alpha[0], alpha[1], alpha[2])
    for i in range(len(goals)):
        h = durations[i] / substeps
        slope = _sum(_row3(goals, i), 1.0, begin, -1.0)
        rate = 1.0 / durations[i] if durations[i] > 0.0 else 1.0
        here = (q[0], q[1], q[2], q[3])
        for step in range(substeps):
            t = (step + 0.5 - math.sqrt(3.0) / 6.0) * h
            other = (step + 0.5 + math.sqrt(3.0) / 6.0) * h
            a = _sum((omega[0], omega[1], omega[2]), 1.0, begin, t)
            b = _sum((omega[0], omega[1], omega[2]), 1.0, begin, other)
            a = _sum(a, 1.0, slope, 0.5 * t * t * rate)
            b = _sum(b, 1.0, slope, 0.5 * other * other * rate)
            share = math.sqrt(3.0) / 24.0 * h * h
            here = multiplied(
                here,
                exponential(
                    h / 4.0 * (a[0] + b[0]) + share * (a[1] * b[2] - a[2] * b[1]),
                    h / 4.0 * (a[1] + b[1]) + share * (a[2] * b[0] - a[0] * b[2]),
                    h / 4.0 * (a[2] + b[2]) + share * (a[0] * b[1] - a[1] * b[0]),
                ),
            )
        ends[i, 0], ends[i, 1], ends[i, 2], ends[i, 3] = here


def _join(
    q: Floats, omega: Floats, alpha: Floats,
    other_q: Floats, other_omega: Floats, other_alpha: Floats, duration: float, w: Floats,
) -> None:  # fmt: skip
    """Write the increments of one join, the shorter way round.

    Args:
        q: where it begins, shape ``(4,)``.
        omega: velocity there, shape ``(3,)``.
        alpha: acceleration there.
        other_q: the same where it ends.
        other_omega: likewise.
        other_alpha: likewise.
        duration: s.
        w: receives the increments, shape ``(5, 3)``.
    """
    middle = _increments(
        (q[0], q[1], q[2], q[3]), (omega[0], omega[1], omega[2]), (alpha[0], alpha[1], alpha[2]),
        (other_q[0], other_q[1], other_q[2], other_q[3]),
        (other_omega[0], other_omega[1], other_omega[2]),
        (other_alpha[0], other_alpha[1], other_alpha[2]), duration, w,
    )  # fmt: skip
    _put_middle(w, middle, 0)


_INDICES = types.Array(int64, 1, "A", readonly=True)
_ONE, _TWO, _THREE = (types.Array(float64, n, "A", readonly=True) for n in (1, 2, 3))
_ENDS = (_TWO,) * 6

look: Look = cast(
    Look,
    njit(
        void(*_ENDS, _INDICES, _ONE, _THREE, _TWO, boolean[:, ::1]),
        error_model="numpy", nogil=True, cache=True,
    )(_look),
)  # fmt: skip
measure: Measure = cast(
    Measure,
    njit(
        int64(*_ENDS, _INDICES, _INDICES, _ONE, _THREE, _TWO, float64[:, ::1]),
        error_model="numpy", nogil=True, cache=True,
    )(_measure),
)  # fmt: skip
turn: Turn = cast(
    Turn,
    njit(
        void(_ONE, _ONE, _ONE, _TWO, _ONE, int64, float64[:, ::1]),
        error_model="numpy", nogil=True, cache=True,
    )(_turn),
)  # fmt: skip
join: Join = cast(
    Join,
    njit(
        void(*(_ONE,) * 6, float64, float64[:, ::1]), error_model="numpy", nogil=True, cache=True
    )(_join),
)  # fmt: skip
