r"""The increments of an interpolating cumulative B-spline by Newton's method, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The equations are those of
:mod:`orientd.curves.interpolation`, and the search is the first attempt of
:mod:`orientd.curves.continuation`: from the spline of Euclidean space straight to the full steps,
every correction at most a quarter of the one before, until only rounding is left.  Where that does
not arrive the whole search begins anew there, which also finds the way for large steps; it takes
single corrections from here.

The block tridiagonal system is eliminated as its rows are made, so that only what the substitution
needs is kept.  Blocks are not exchanged for pivots: Newton's method corrects what that costs.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import (
    add_derivative,
    exponential,
    inner,
    logarithm,
    multiplied,
    relative,
)
from orientd.curves.fast import Correct, Increments
from orientd.rotation import Floats

_LARGEST_FIRST = 0.4
_CONTRACTION = 0.25
_ROUNDING = 1e-7
_POLISHED = 1e-14
_POLISHINGS = 8


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
    row: int, index: Indices, share: Floats, steps: Floats, scale: float, unknown: Floats,
    heads: Floats, tails: Floats, ratios: tuple[float, float],
    is_flat: bool, blocks: Floats, error: Floats,
) -> None:  # fmt: skip
    """Write the derivatives of a row left of, on and right of the diagonal, and its error."""
    blocks[:] = 0.0
    settled = max(1, len(heads))
    after = (1.0, 0.0, 0.0, 0.0)
    for i in range(3):
        error[i] = -scale * steps[row, i]
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
                add_derivative(block, part * c, (2.0 * x, 2.0 * y, 2.0 * z), after)
        if not is_flat:
            after = multiplied(exponential(x, y, z), after)
    if not is_flat:
        x, y, z = scale * steps[row, 0], scale * steps[row, 1], scale * steps[row, 2]
        target = exponential(x, y, z)
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


def _correct(
    index: Indices, share: Floats, steps: Floats, scale: float, heads: Floats, tails: Floats,
    start_ratio: float, end_ratio: float, unknown: Floats, rows: Indices, is_flat: bool,
    correction: Floats,
) -> float:  # fmt: skip
    """Write a Newton step, or the solution in Euclidean space, and return its largest component.

    Args:
        index: see :class:`~orientd.curves.interpolation.KeyframeEquations`, shape ``(N, F)``.
        share: likewise, shape ``(N, F)``.
        steps: likewise, shape ``(N, 3)``.
        scale: of the steps; the known increments are scaled already.
        heads: known increments at the start, the outermost first, shape ``(0..2, 3)``.
        tails: known increments at the end, the outermost first.
        start_ratio: with no heads, the first increment is this multiple of the next one.
        end_ratio: likewise at the end.
        unknown: the increments that are not settled, shape ``(N, 3)``.
        rows: increasing numbers of the rows to correct; the other unknowns stay as they are.
        is_flat: whether to solve in Euclidean space.
        correction: receives the step of those rows, shape ``(n, 3)``.
    """
    ratios = start_ratio, end_ratio
    count = len(rows)
    blocks, error = np.empty((3, 3, 3)), np.empty(3)
    # Of each row, what it leaves of the block right of the diagonal and of the right side.
    onward = np.empty((count, 3, 4))
    for k in range(count):
        row = rows[k]
        _linearised(
            row, index, share, steps, scale, unknown, heads, tails, ratios, is_flat, blocks, error
        )
        here = onward[k]
        for i in range(3):
            here[i, 0], here[i, 1], here[i, 2] = blocks[2, i, 0], blocks[2, i, 1], blocks[2, i, 2]
            here[i, 3] = -error[i]
        if k and rows[k - 1] == row - 1:
            before = onward[k - 1]
            for i in range(3):
                for k in range(3):
                    factor = blocks[0, i, k]
                    for j in range(3):
                        blocks[1, i, j] -= factor * before[k, j]
                    here[i, 3] -= factor * before[k, 3]
        if not _solved(blocks[1], here):
            return np.inf
    largest = 0.0
    for k in range(count - 1, -1, -1):
        for i in range(3):
            total = onward[k, i, 3]
            if k < count - 1 and rows[k + 1] == rows[k] + 1:
                for j in range(3):
                    total -= onward[k, i, j] * correction[k + 1, j]
            correction[k, i] = total
            # Not `>`: what is not a number must not pass for small.
            if not abs(total) <= largest:
                largest = abs(total)
    return largest


def _find(
    index: Indices, share: Floats, steps: Floats, heads: Floats, tails: Floats,
    start_ratio: float, end_ratio: float, unknown: Floats,
) -> bool:  # fmt: skip
    """Write the unknown increments, or return that they were not found this way.

    Arguments are as in :func:`_correct`; *unknown* receives the increments.
    """
    rows, correction = np.empty(len(steps), dtype=np.int64), np.empty((len(steps), 3))
    for i in range(len(rows)):
        rows[i] = i
    unknown[:] = 0.0
    # One loop and one call for all three parts of the search: it is what takes long to compile.
    limit, step, polishing = np.inf, 0, -1
    while True:
        size = correct(
            index, share, steps, 1.0, heads, tails, start_ratio, end_ratio,
            unknown, rows, step == 0, correction,
        )  # fmt: skip
        if polishing >= 0 and not size <= limit:
            break
        if not (size <= limit and size < np.inf):
            return False
        largest = 1.0
        for i in range(len(unknown)):
            for k in range(3):
                unknown[i, k] += correction[i, k]
                largest = max(largest, abs(unknown[i, k]))
        step += 1
        if step == 1:
            limit = _LARGEST_FIRST
        elif polishing < 0 and size > _ROUNDING:
            limit = max(_CONTRACTION * size, _ROUNDING)
        elif polishing < 0:
            limit, polishing = _LARGEST_FIRST, 0
            enough = _POLISHED * largest
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
_CORRECT = float64(
    _INDICES, _VECTORS, _VECTORS, float64, _VECTORS, _VECTORS, float64, float64,
    _VECTORS, types.Array(int64, 1, "C", readonly=True), boolean, float64[:, ::1],
)  # fmt: skip
_FIND = boolean(_INDICES, _VECTORS, _VECTORS, _VECTORS, _VECTORS, float64, float64, float64[:, ::1])

correct: Correct = cast(
    Correct, njit(_CORRECT, error_model="numpy", nogil=True, cache=True)(_correct)
)
find: Increments = cast(Increments, njit(_FIND, error_model="numpy", nogil=True, cache=True)(_find))
