"""Backward differences of setpoints and the largest of them, a block at a time, by Numba.

Imported by compiled kernels only.  The reference is
:func:`orientd.planner.differences.differences`.  A block is one row of numbers: so many for each
component, one component after the other, in places that are known when it is compiled, so that the
loops need no checks of whether they overlap and go to the vector units of the processor.
"""

from __future__ import annotations

import math

import numpy as np
from numba import uint64

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import conjugated, inner, logarithm, multiplied
from orientd.planner.differences import HISTORY
from orientd.rotation import Floats

BLOCK = 256
"""Setpoints in a block; each but the first begins with the last :data:`HISTORY` of the one before.
"""

_W, _X, _Y, _Z = (row * BLOCK for row in range(4))
_RATES = 4 * BLOCK
_SQUARES = 13 * BLOCK
BRAKES = 16 * BLOCK
"""Where sizes of velocity and acceleration, their product and the size of the jerk are."""

_ROWS = 20
_SMALL = 1.0 / 1024.0  # square of the tangent of the half angle


@inner
def new_block() -> Floats:
    """Return the memory of a block."""
    return np.zeros(_ROWS * BLOCK)


@inner
def put(block: Floats, place: int, w: float, x: float, y: float, z: float) -> None:
    """Write a setpoint."""
    block[_W + place], block[_X + place], block[_Y + place], block[_Z + place] = w, x, y, z


@inner
def keep_last(block: Floats, count: int) -> int:
    """Move the last setpoints of a block to its beginning, and return how many these are."""
    kept = min(count, HISTORY)
    for i in range(kept):
        last = count - kept + i
        put(block, i, block[_W + last], block[_X + last], block[_Y + last], block[_Z + last])
    return kept


@inner
def _turn(block: Floats, count: int) -> int:
    """Write the rotation vectors between setpoints, and return how many are too large for that.

    Up to a sixteenth of a radian the series of ``atan(t) / t`` is exact to the last digit.
    """
    large = 0
    for i in range(uint64(count - 1)):
        a, b, c, d = block[_W + i], block[_X + i], block[_Y + i], block[_Z + i]
        e, f, g, h = block[_W + 1 + i], block[_X + 1 + i], block[_Y + 1 + i], block[_Z + 1 + i]
        w = a * e + b * f + c * g + d * h
        x = a * f - b * e - c * h + d * g
        y = a * g + b * h - c * e - d * f
        z = a * h - b * g + c * f - d * e
        square = (x * x + y * y + z * z) / (w * w)
        large += int(not square < _SMALL)
        rest = 1 / 5 - square * (1 / 7 - square * (1 / 9 - square / 11))
        factor = 2.0 * (1.0 - square * (1 / 3 - square * rest)) / w
        block[_RATES + i] = factor * x
        block[_RATES + BLOCK + i] = factor * y
        block[_RATES + 2 * BLOCK + i] = factor * z
    return large


@inner
def _turn_far(block: Floats, count: int) -> None:
    """Write the rotation vectors that the series is not good for."""
    for i in range(count - 1):
        here = block[_W + i], block[_X + i], block[_Y + i], block[_Z + i]
        j = i + 1
        there = block[_W + j], block[_X + j], block[_Y + j], block[_Z + j]
        w, x, y, z = multiplied(conjugated(here), there)
        if w < 0.0:
            w, x, y, z = -w, -x, -y, -z
        if not x * x + y * y + z * z < _SMALL * (w * w):
            x, y, z = logarithm((w, x, y, z))
            block[_RATES + i] = 2.0 * x
            block[_RATES + BLOCK + i] = 2.0 * y
            block[_RATES + 2 * BLOCK + i] = 2.0 * z


@inner
def _differ(block: Floats, count: int) -> None:
    """Write the changes of the rotation vectors, the changes of those, and all squared norms."""
    for k in range(6):
        row = _RATES + k * BLOCK
        for i in range(uint64(count - 2)):
            block[row + 3 * BLOCK + i] = block[row + i + 1] - block[row + i]
    for order in range(3):
        row, squares = _RATES + 3 * order * BLOCK, _SQUARES + order * BLOCK
        for i in range(uint64(count - 1)):
            x, y, z = block[row + i], block[row + BLOCK + i], block[row + 2 * BLOCK + i]
            block[squares + i] = x * x + y * y + z * z


@inner
def _larger(block: Floats, begin: int, end: int, largest: float) -> int:
    """Return how many of some numbers are not at most *largest*."""
    larger = 0
    for i in range(uint64(begin), uint64(end)):
        larger += int(not block[i] <= largest)
    return larger


@inner
def _is_new(square: float, largest: float) -> bool:
    """Return whether a square is larger than those before; one that is not a number stays."""
    return not square <= largest and largest < math.inf


@inner
def see(
    block: Floats, count: int, past: int, with_axes: bool, shift: int, largest: Floats,
    places: Indices,
) -> None:  # fmt: skip
    """Take the differences of a block, and note the largest.

    Args:
        block: from :func:`new_block`, with the setpoints; receives all the rest.
        count: how many setpoints there are.
        past: how many accelerations, and twice as many velocities, are not to count as largest.
        with_axes: whether the largest components are wanted, too.
        shift: what to add to a place in the block.
        largest: the largest squares so far, of norm and components, shape ``(3, 4)``.
        places: where these are, shape ``(3, 4)``.
    """
    if count < 2:
        return
    if _turn(block, count):
        _turn_far(block, count)
    _differ(block, count)
    for order in range(3):
        first, end = (2 - order) * past, count - 1 - order
        row = _SQUARES + order * BLOCK
        if first < end and _larger(block, row + first, row + end, largest[order, 0]):
            for i in range(first, end):
                if _is_new(block[row + i], largest[order, 0]):
                    largest[order, 0], places[order, 0] = block[row + i], shift + i
        if with_axes:
            for i in range(first, end):
                for k in range(3):
                    square = block[_RATES + (3 * order + k) * BLOCK + i] ** 2
                    if _is_new(square, largest[order, k + 1]):
                        largest[order, k + 1], places[order, k + 1] = square, shift + i


@inner
def put_sizes(block: Floats, points: int, period: float, start: float, rough: Floats) -> None:
    """Write sizes of velocity and acceleration, their product and the jerk, for the brake rate.

    Args:
        block: after :func:`see`.
        points: how many third differences there are.
        period: from one setpoint to the next, s.
        start: path time of the fourth setpoint, s.
        rough: from when and until when acceleration and jerk may be larger between the records,
            and how many times, shape ``(4,)``.
    """
    unit, unit2, unit3 = 1.0 / period, 1.0 / period**2, 1.0 / period**3
    begin, end, more, most = rough[0], rough[1], rough[2], rough[3]
    for i in range(uint64(points)):
        v, a = _RATES + 2 + i, _RATES + 3 * BLOCK + 1 + i
        time = start + period * i
        is_rough = (begin <= time) & (time < end)
        bends = unit2 * (more if is_rough else 1.0)
        twists = unit3 * (most if is_rough else 1.0)
        along = (
            block[v] * block[a]
            + block[BLOCK + v] * block[BLOCK + a]
            + block[2 * BLOCK + v] * block[2 * BLOCK + a]
        )
        block[BRAKES + i] = unit * math.sqrt(block[_SQUARES + 2 + i])
        block[BRAKES + BLOCK + i] = bends * math.sqrt(block[_SQUARES + BLOCK + 1 + i])
        block[BRAKES + 2 * BLOCK + i] = unit * bends * abs(along)
        block[BRAKES + 3 * BLOCK + i] = twists * math.sqrt(block[_SQUARES + 2 * BLOCK + i])


@inner
def put_sizes_about(
    block: Floats, axis: int, points: int, period: float, start: float, rough: Floats
) -> None:
    """Write what :func:`put_sizes` does for one axis, 0 to 2."""
    unit, unit2, unit3 = 1.0 / period, 1.0 / period**2, 1.0 / period**3
    begin, end, more, most = rough[0], rough[1], rough[2], rough[3]
    first = _RATES + axis * BLOCK
    for i in range(points):
        time = start + period * i
        is_rough = (begin <= time) & (time < end)
        bends = unit2 * (more if is_rough else 1.0)
        twists = unit3 * (most if is_rough else 1.0)
        speed = unit * abs(block[first + 2 + i])
        size = bends * abs(block[first + 3 * BLOCK + 1 + i])
        block[BRAKES + i], block[BRAKES + BLOCK + i] = speed, size
        block[BRAKES + 2 * BLOCK + i] = speed * size
        block[BRAKES + 3 * BLOCK + i] = twists * abs(block[first + 6 * BLOCK + i])
