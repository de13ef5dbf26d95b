r"""The increments of an interpolating cumulative B-spline by Newton's method, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The equations are those of
:mod:`orientd.curves.interpolation`, and the search is the first attempt of
:mod:`orientd.curves.continuation`: from the spline of Euclidean space straight to the full steps,
every correction at most a quarter of the one before, until only rounding is left.  Where that does
not arrive the whole search begins anew with NumPy, which also finds the way for large steps.

The block tridiagonal system is eliminated as its rows are made, so that only what the substitution
needs is kept.  Blocks are not exchanged for pivots: Newton's method corrects what that costs.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import (
    Quaternion,
    Vector,
    exponential,
    inner,
    logarithm,
    multiplied,
    relative,
)
from orientd.curves.fast import Increments
from orientd.rotation import Floats

_LARGEST_FIRST = 0.4
_CONTRACTION = 0.25
_ROUNDING = 1e-7
_POLISHED = 1e-14
_POLISHINGS = 8
_SEAM = 0.25  # rad, below which a series replaces the quotient that cancels


@inner
def _jacobian_factors(square: float) -> tuple[float, float]:
    r"""Return :math:`(1-\cos\theta)/\theta^2` and :math:`(\theta-\sin\theta)/\theta^3`."""
    theta = math.sqrt(square)
    half = 0.5 * theta
    sinc = math.sin(half) / half if half > 0.0 else 1.0
    if theta < _SEAM:
        second = (
            1 / 6
            + square * (-1 / 120 + square * (1 / 5040 + square * (-1 / 362880 + square / 39916800)))
        )  # fmt: skip
    else:
        second = (theta - math.sin(theta)) / (theta * square)
    return 0.5 * sinc * sinc, second


@inner
def _turned_back(q: Quaternion, x: float, y: float, z: float) -> Vector:
    """Return a vector rotated by the conjugate of a unit quaternion."""
    w, a, b, c = q
    tx = 2.0 * (y * c - z * b)
    ty = 2.0 * (z * a - x * c)
    tz = 2.0 * (x * b - y * a)
    return (
        x + w * tx + (ty * c - tz * b),
        y + w * ty + (tz * a - tx * c),
        z + w * tz + (tx * b - ty * a),
    )


@inner
def _add_derivative(block: Floats, c: float, v: Vector, after: Quaternion) -> None:
    r"""Add :math:`c\,R(S)^T J_r(v)` to a block, column by column.

    .. math:: J_r(v)\,e = e - a\,v \times e + b\,v \times (v \times e)
    """
    x, y, z = v
    square = x * x + y * y + z * z
    a, b = _jacobian_factors(square)
    rest = 1.0 - b * square
    first = _turned_back(after, rest + b * x * x, b * x * y - a * z, b * x * z + a * y)
    second = _turned_back(after, b * x * y + a * z, rest + b * y * y, b * y * z - a * x)
    third = _turned_back(after, b * x * z - a * y, b * y * z + a * x, rest + b * z * z)
    block[0, 0] += c * first[0]
    block[1, 0] += c * first[1]
    block[2, 0] += c * first[2]
    block[0, 1] += c * second[0]
    block[1, 1] += c * second[1]
    block[2, 1] += c * second[2]
    block[0, 2] += c * third[0]
    block[1, 2] += c * third[1]
    block[2, 2] += c * third[2]


@inner
def _factor(
    place: int, unknown: Floats, heads: Floats, tails: Floats, ratios: tuple[float, float]
) -> tuple[int, float, float, float, float]:
    """Return which unknown a factor depends on (-1: none), its share of it, and its vector."""
    last = len(unknown) - 1
    if place < 0:
        if len(heads):
            settled = heads[place + len(heads)]
            return -1, 0.0, settled[0], settled[1], settled[2]
        return 0, ratios[0], *_scaled(ratios[0], unknown[0])
    if place > last:
        if len(tails):
            settled = tails[last + len(tails) - place]
            return -1, 0.0, settled[0], settled[1], settled[2]
        return last, ratios[1], *_scaled(ratios[1], unknown[last])
    return place, 1.0, *_scaled(1.0, unknown[place])


@inner
def _scaled(factor: float, v: Floats) -> tuple[float, float, float]:
    return factor * v[0], factor * v[1], factor * v[2]


@inner
def _linearised(
    row: int, index: Indices, share: Floats, steps: Floats, unknown: Floats,
    heads: Floats, tails: Floats, ratios: tuple[float, float],
    is_flat: bool, blocks: Floats, error: Floats,
) -> None:  # fmt: skip
    """Write the derivatives of a row left of, on and right of the diagonal, and its error."""
    blocks[:] = 0.0
    settled = max(1, len(heads))
    after = (1.0, 0.0, 0.0, 0.0)
    error[:] = -steps[row]
    for f in range(index.shape[1] - 1, -1, -1):
        c = share[row, f]
        owner, part, x, y, z = _factor(index[row, f] - settled, unknown, heads, tails, ratios)
        x, y, z = c * x, c * y, c * z
        if is_flat:
            error[0] += x
            error[1] += y
            error[2] += z
        if owner >= 0:
            block = blocks[owner - row + 1]
            if is_flat:
                for i in range(3):
                    block[i, i] += part * c
            else:
                _add_derivative(block, part * c, (2.0 * x, 2.0 * y, 2.0 * z), after)
        if not is_flat:
            after = multiplied(exponential(x, y, z), after)
    if not is_flat:
        target = exponential(steps[row, 0], steps[row, 1], steps[row, 2])
        error[0], error[1], error[2] = logarithm(relative(target, after))


@inner
def _solved(matrix: Floats, right: Floats) -> bool:
    """Replace the columns of *right* by the solutions for a 3 by 3 matrix; overwrites both."""
    for i in range(3):
        best = i
        for k in range(i + 1, 3):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if not abs(matrix[best, i]) > 0.0:
            return False
        if best != i:
            for j in range(3):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
            for j in range(right.shape[1]):
                right[i, j], right[best, j] = right[best, j], right[i, j]
        for k in range(i + 1, 3):
            factor = matrix[k, i] / matrix[i, i]
            for j in range(i + 1, 3):
                matrix[k, j] -= factor * matrix[i, j]
            for j in range(right.shape[1]):
                right[k, j] -= factor * right[i, j]
    for j in range(right.shape[1]):
        for i in range(2, -1, -1):
            total = right[i, j]
            for k in range(i + 1, 3):
                total -= matrix[i, k] * right[k, j]
            right[i, j] = total / matrix[i, i]
    return True


@inner
def _correct(
    index: Indices, share: Floats, steps: Floats, unknown: Floats,
    heads: Floats, tails: Floats, ratios: tuple[float, float],
    is_flat: bool, onward: Floats, correction: Floats,
) -> float:  # fmt: skip
    """Write a Newton step, or the solution in Euclidean space, and return its largest component.

    Args:
        onward: memory, shape ``(N, 3, 4)``: of each row, what it leaves of the block right of the
            diagonal and of the right side.
    """
    count = len(steps)
    blocks, error = np.empty((3, 3, 3)), np.empty(3)
    for row in range(count):
        _linearised(row, index, share, steps, unknown, heads, tails, ratios, is_flat, blocks, error)
        here = onward[row]
        here[:, :3] = blocks[2]
        here[:, 3] = -error
        if row:
            before = onward[row - 1]
            for i in range(3):
                for k in range(3):
                    factor = blocks[0, i, k]
                    for j in range(3):
                        blocks[1, i, j] -= factor * before[k, j]
                    here[i, 3] -= factor * before[k, 3]
        if not _solved(blocks[1], here):
            return np.inf
    largest = 0.0
    for row in range(count - 1, -1, -1):
        for i in range(3):
            total = onward[row, i, 3]
            if row < count - 1:
                for k in range(3):
                    total -= onward[row, i, k] * correction[row + 1, k]
            correction[row, i] = total
            # Not `>`: what is not a number must not pass for small.
            if not abs(total) <= largest:
                largest = abs(total)
    return largest


def _find(
    index: Indices, share: Floats, steps: Floats, heads: Floats, tails: Floats,
    start_ratio: float, end_ratio: float, unknown: Floats,
) -> bool:  # fmt: skip
    """Write the unknown increments, or return that they were not found this way.

    Args:
        index: see :class:`~orientd.curves.interpolation.KeyframeEquations`, shape ``(N, F)``.
        share: likewise, shape ``(N, F)``.
        steps: likewise, shape ``(N, 3)``.
        heads: known increments at the start, the outermost first, shape ``(0..2, 3)``.
        tails: known increments at the end, the outermost first.
        start_ratio: with no heads, the first increment is this multiple of the next one.
        end_ratio: likewise at the end.
        unknown: receives the increments that are not settled, shape ``(N, 3)``.
    """
    ratios = start_ratio, end_ratio
    onward, correction = np.empty((len(steps), 3, 4)), np.empty((len(steps), 3))
    unknown[:] = 0.0
    # One loop and one call for all three parts of the search: it is what takes long to compile.
    limit, step, polishing = np.inf, 0, -1
    while True:
        size = _correct(
            index, share, steps, unknown, heads, tails, ratios, step == 0, onward, correction
        )
        if polishing >= 0 and not size <= limit:
            break
        if not (size <= limit and size < np.inf):
            return False
        unknown += correction
        step += 1
        if step == 1:
            limit = _LARGEST_FIRST
        elif polishing < 0 and size > _ROUNDING:
            limit = max(_CONTRACTION * size, _ROUNDING)
        elif polishing < 0:
            limit, polishing = _LARGEST_FIRST, 0
            enough = _POLISHED * max(1.0, np.max(np.abs(unknown)))
        else:
            polishing += 1
            if size <= enough:
                return True
            limit = 0.5 * size
            if polishing == _POLISHINGS:
                break
    return limit <= _ROUNDING


_INDICES = types.Array(int64, 2, "C", readonly=True)
_VECTORS = types.Array(float64, 2, "C", readonly=True)
_SIGNATURE = boolean(
    _INDICES, _VECTORS, _VECTORS, _VECTORS, _VECTORS, float64, float64, float64[:, ::1]
)

find: Increments = cast(
    Increments, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_find)
)
