"""What a certificate takes of every record, compiled by Numba.

Imported by :mod:`orientd.planner.fast` only.  The references are
:func:`orientd.planner.differences.differences` and :mod:`orientd.planner.brake`.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types, void

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import (
    Quaternion,
    Vector,
    conjugated,
    inner,
    logarithm,
    multiplied,
)
from orientd.planner.fast import Differences, Extremes, LeastRate
from orientd.rotation import Floats

_SMALL = 1.0 / 1024.0  # square of the tangent of the half angle


@inner
def _logarithm(q: Quaternion) -> Vector:
    """Return the half-angle vector of a quaternion, for most setpoints without an arc tangent.

    Up to a sixteenth of a radian the series of ``atan(t) / t`` is exact to the last digit.
    """
    w, x, y, z = q
    square = (x * x + y * y + z * z) / (w * w)
    if not square < _SMALL:
        return logarithm(q)
    rest = 1 / 5 - square * (1 / 7 - square * (1 / 9 - square / 11))
    factor = (1.0 - square * (1 / 3 - square * rest)) / w
    return factor * x, factor * y, factor * z


@inner
def is_new(square: float, largest: float) -> bool:
    """Return whether a square is larger than those before; one that is not a number stays."""
    return not square <= largest and largest < math.inf


@inner
def _see_components(
    rates: Floats, order: int, first: int, largest: Floats, places: Indices
) -> None:
    """Take note of the largest components of some rates from a place on."""
    for i in range(first, len(rates)):
        for k in range(3):
            square = rates[i, k] ** 2
            if is_new(square, largest[order, k + 1]):
                largest[order, k + 1], places[order, k + 1] = square, i


def _differences(
    q: Floats, past: int, with_axes: bool, omega: Floats, alpha: Floats, jerk: Floats,
    squares: Floats, largest: Floats, places: Indices,
) -> None:  # fmt: skip
    """Write the first three backward differences of orientations, in units of rad a period.

    Args:
        q: setpoints, shape ``(n, 4)``.
        past: how many accelerations, and twice as many velocities, are not to count as largest.
        with_axes: whether the largest components are wanted, too.
        omega: receives the rotation vectors from one to the next, shape ``(n - 1, 3)``.
        alpha: receives the change of these, shape ``(n - 2, 3)``.
        jerk: receives the change of these, shape ``(n - 3, 3)``.
        squares: receives the squared norms of all three, shape ``(3, n)``.
        largest: receives the largest squares, of norm and components, shape ``(3, 4)``; zeros.
        places: receives where these are, shape ``(3, 4)``; zeros.
    """
    # What a loop keeps in variables costs a third of what it reads back from its results.
    turn, bend, twist = 0.0, 0.0, 0.0
    turns_at, bends_at, twists_at = 0, 0, 0
    ux, uy, uz = 0.0, 0.0, 0.0
    vx, vy, vz = 0.0, 0.0, 0.0
    if not len(q):
        return
    there = q[0, 0], q[0, 1], q[0, 2], q[0, 3]
    for i in range(len(q) - 1):
        here, there = there, (q[i + 1, 0], q[i + 1, 1], q[i + 1, 2], q[i + 1, 3])
        w, x, y, z = multiplied(conjugated(here), there)
        if w < 0.0:
            w, x, y, z = -w, -x, -y, -z
        x, y, z = _logarithm((w, x, y, z))
        x, y, z = 2.0 * x, 2.0 * y, 2.0 * z
        omega[i, 0], omega[i, 1], omega[i, 2] = x, y, z
        square = x * x + y * y + z * z
        squares[0, i] = square
        if i >= 2 * past and is_new(square, turn):
            turn, turns_at = square, i
        ax, ay, az = x - ux, y - uy, z - uz
        ux, uy, uz = x, y, z
        if i >= 1:
            alpha[i - 1, 0], alpha[i - 1, 1], alpha[i - 1, 2] = ax, ay, az
            square = ax * ax + ay * ay + az * az
            squares[1, i - 1] = square
            if i - 1 >= past and is_new(square, bend):
                bend, bends_at = square, i - 1
        jx, jy, jz = ax - vx, ay - vy, az - vz
        vx, vy, vz = ax, ay, az
        if i >= 2:
            jerk[i - 2, 0], jerk[i - 2, 1], jerk[i - 2, 2] = jx, jy, jz
            square = jx * jx + jy * jy + jz * jz
            squares[2, i - 2] = square
            if is_new(square, twist):
                twist, twists_at = square, i - 2
    largest[0, 0], largest[1, 0], largest[2, 0] = turn, bend, twist
    places[0, 0], places[1, 0], places[2, 0] = turns_at, bends_at, twists_at
    if with_axes:
        _see_components(omega, 0, 2 * past, largest, places)
        _see_components(alpha, 1, past, largest, places)
        _see_components(jerk, 2, 0, largest, places)


_ONE = types.Array(float64, 1, "A", readonly=True)
_TWO = types.Array(float64, 2, "A", readonly=True)
_OUT = float64[:, ::1]
_SIGNATURE = void(_TWO, int64, boolean, _OUT, _OUT, _OUT, _OUT, _OUT, int64[:, ::1])

differences: Differences = cast(
    Differences, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_differences)
)


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


def _extremes(
    q: Floats, past: int, with_axes: bool, period: float, start: float, rough: Floats,
    with_rate: bool, most: Floats, sigma: Floats, g: Floats, worst: Floats,
    sigma_g: float, fastest: float, margin: float, best: float, largest: Floats, places: Indices,
) -> tuple[float, int]:  # fmt: skip
    """Write the largest backward differences, and return the least brake rate and what sets it.

    Args:
        q: as in :func:`_differences`, like all that have the same name.
        past: likewise.
        with_axes: likewise.
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
    count = len(q)
    omega, alpha = np.empty((max(count - 1, 0), 3)), np.empty((max(count - 2, 0), 3))
    jerk, squares = np.empty((max(count - 3, 0), 3)), np.empty((3, count))
    differences(q, past, with_axes, omega, alpha, jerk, squares, largest, places)
    points = len(jerk)
    if not with_rate or not points:
        return best, 0
    speed, size, along, twist = (
        np.empty(points), np.empty(points), np.empty(points), np.empty(points)
    )  # fmt: skip
    unit, unit2, unit3 = 1.0 / period, 1.0 / period**2, 1.0 / period**3
    # The norm, then the components where they are limited.
    columns = 4 if with_axes else 1
    place = 0
    for column in range(columns):
        for i in range(points):
            time = start + period * i
            is_rough = rough[0] <= time < rough[1]
            bends = unit2 * (rough[2] if is_rough else 1.0)
            twists = unit3 * (rough[3] if is_rough else 1.0)
            v, a = omega[i + 2], alpha[i + 1]
            if column:
                axis = column - 1
                speed[i], size[i] = unit * abs(v[axis]), bends * abs(a[axis])
                along[i], twist[i] = speed[i] * size[i], twists * abs(jerk[i, axis])
            else:
                product = v[0] * a[0] + v[1] * a[1] + v[2] * a[2]
                speed[i], size[i] = (
                    unit * math.sqrt(squares[0, i + 2]), bends * math.sqrt(squares[1, i + 1])
                )  # fmt: skip
                along[i], twist[i] = unit * bends * abs(product), twists * math.sqrt(squares[2, i])
        found, where = _least(
            speed, size, along, twist, most[0, column], most[1, column],
            sigma, g, worst, sigma_g, fastest, margin, best,
        )  # fmt: skip
        if found < best:
            best, place = found, where
    return best, place


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
