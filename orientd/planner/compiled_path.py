"""A plain path sampled, and its records held against limits, each in one loop by Numba.

Imported by :mod:`orientd.planner.fast` only.  The references are :class:`orientd.planner.path.Path`
and :func:`orientd.planner.measuring.measure`.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types, void

from orientd.curves.basis import Indices
from orientd.curves.compiled import ROWS
from orientd.curves.compiled import fill as fill_cubic
from orientd.curves.compiled_product import fill as fill_product
from orientd.curves.compiled_rotation import angle, inner, quaternion
from orientd.planner.compiled_certificate import slowest
from orientd.planner.compiled_differences import BLOCK, keep_last, new_block, put, see
from orientd.planner.differences import HISTORY
from orientd.planner.fast import FarthestFrom, PathExtremes, SamplePath
from orientd.planner.plain_path import HEAD, STRETCH_HEAD
from orientd.rotation import Floats


@inner
def _fill(times: Floats, spans: int, factors: int, numbers: Floats, out: Floats) -> None:
    """Write samples of a curve at instants in its domain, shape ``(10, n)``."""
    breaks, rest = numbers[: spans + 1], numbers[spans + 1 :]
    if factors == 0:
        fill_cubic(times, breaks, rest[: ROWS * spans].reshape(ROWS, spans), 0.0, out)
        return
    base, rest = rest[: 4 * spans].reshape(4, spans), rest[4 * spans :]
    count = factors * spans
    axes, rest = rest[: 3 * count].reshape(factors, 3, spans), rest[3 * count :]
    lengths, rest = rest[:count].reshape(factors, spans), rest[count:]
    size = count * (factors + 1)
    values, rest = rest[:size].reshape(spans, factors, factors + 1), rest[size:]
    size = count * factors
    rates, rest = rest[:size].reshape(spans, factors, factors), rest[size:]
    low = max(factors - 1, 1)
    curvatures = rest[: count * low].reshape(spans, factors, low)
    fill_product(times, breaks, base, axes, lengths, values, rates, curvatures, 0.0, out)


@inner
def _size(spans: int, factors: int) -> int:
    """Return how many numbers a curve is sampled from."""
    if factors == 0:
        return spans + 1 + ROWS * spans
    of_basis = factors + 1 + factors + max(factors - 1, 1)
    return spans + 1 + 4 * spans + factors * spans * (3 + 1 + of_basis)


@inner
def _sample(path: Floats, times: Floats, out: Floats) -> None:
    """Write a path at increasing instants; see :func:`_sample_path`."""
    count, rows = int(path[0]), out.shape[0]
    final = np.searchsorted(times, path[1])
    first = min(np.searchsorted(times, 0.0), final)
    for row in range(rows):
        for i in range(first):
            out[row, i] = path[2 + row] if row < 4 else 0.0
        for i in range(final, len(times)):
            out[row, i] = path[6 + row] if row < 4 else 0.0
    place = HEAD
    for k in range(count):
        begin, skipped, rate, sign = path[place], path[place + 1], path[place + 2], path[place + 3]
        spans, factors = int(path[place + 4]), int(path[place + 5])
        curve = path[place + STRETCH_HEAD :]
        place += STRETCH_HEAD + _size(spans, factors)
        stop = final
        if k + 1 < count:
            stop = min(np.searchsorted(times, path[place]), final)
        if stop == first:
            continue
        low, high = curve[0], curve[spans]
        instants, found = np.empty(stop - first), np.empty((10, stop - first))
        for i in range(len(instants)):
            t = (times[first + i] - begin + skipped) * rate + (low if rate > 0.0 else high)
            instants[i] = min(max(t, low), high)
        _fill(instants, spans, factors, curve, found)
        for row in range(rows):
            factor = sign if row < 4 else rate if row < 7 else rate**2
            for i in range(len(instants)):
                out[row, first + i] = factor * found[row, i]
        first = stop


def _sample_path(path: Floats, times: Floats, out: Floats) -> None:
    """Write orientations, and velocities and accelerations where there is room for them.

    Args:
        path: the row of numbers of :mod:`orientd.planner.plain_path`.
        times: increasing path times, s, shape ``(n,)``.
        out: receives samples, shape ``(4, n)`` or ``(10, n)``.
    """
    _sample(path, times, out)


def _farthest_from(path: Floats, times: Floats, keys: Floats) -> float:
    """Return the largest angle between orientations and a path, rad.

    Args:
        path: as in :func:`_sample_path`.
        times: increasing path times, s, shape ``(n,)``.
        keys: orientations that the path should have then, shape ``(n, 4)``.
    """
    out = np.empty((4, len(times)))
    _sample(path, times, out)
    largest = 0.0
    for i in range(len(times)):
        here = angle((out[0, i], out[1, i], out[2, i], out[3, i]), quaternion(keys, i))
        if not here <= largest:
            largest = here
    return largest


def _path_extremes(
    path: Floats, records: int, period: float, before: Floats, with_axes: bool, rough: Floats,
    most: Floats, sigma: Floats, g: Floats, worst: Floats, sigma_g: float, fastest: float,
    margin: float, largest: Floats, places: Indices,
) -> tuple[float, int]:  # fmt: skip
    """Write the largest backward differences of a path that is held after its last record.

    Args:
        path: as in :func:`_sample_path`.
        records: how many there are.
        period: from one to the next, s.
        before: setpoints before the first, shape ``(3, 4)``, or ``(0, 4)`` if they are not known.
        with_axes: as in :func:`orientd.planner.compiled_certificate._extremes`, like all the rest.
        rough: likewise.
        most: likewise.
        sigma: likewise.
        g: likewise.
        worst: likewise.
        sigma_g: likewise.
        fastest: likewise.
        margin: likewise.
        largest: likewise.
        places: likewise, counted from the first difference of all.

    Returns:
        The least brake rate, and which third difference sets it.
    """
    tail = len(before)
    block, rate, place = new_block(), fastest, 0
    for i in range(tail):
        put(block, i, before[i, 0], before[i, 1], before[i, 2], before[i, 3])
    known, read, end = tail, 0, records + HISTORY
    while read < end:
        count = min(BLOCK, known + end - read)
        times, out = np.empty(count - known), np.empty((4, count - known))
        for i in range(len(times)):
            times[i] = period * min(read + i, records - 1)
        _sample(path, times, out)
        for i in range(len(times)):
            put(block, known + i, out[0, i], out[1, i], out[2, i], out[3, i])
        read += len(times)
        # Places count from the first setpoint before the path.
        shift = read - count + tail
        past = 1 if tail and not shift else 0
        see(block, count, past, with_axes, shift, largest, places)
        rate, place = slowest(
            block, count, shift, with_axes, period, period * (HISTORY - tail), rough, most, sigma,
            g, worst, sigma_g, fastest, margin, rate, place,
        )  # fmt: skip
        known = keep_last(block, count)
    return rate, place


_ONE = types.Array(float64, 1, "C", readonly=True)
_TWO = types.Array(float64, 2, "C", readonly=True)
_ROWS = types.Array(float64, 2, "A", readonly=True)
_OUT = float64[:, ::1]
_RATE = types.Tuple((float64, int64))  # type: ignore[no-untyped-call]  # Numba's own

sample_path: SamplePath = cast(
    SamplePath,
    njit(void(_ONE, _ONE, _OUT), error_model="numpy", nogil=True, cache=True)(_sample_path),
)
farthest_from: FarthestFrom = cast(
    FarthestFrom,
    njit(float64(_ONE, _ONE, _ROWS), error_model="numpy", nogil=True, cache=True)(_farthest_from),
)
path_extremes: PathExtremes = cast(
    PathExtremes,
    njit(
        _RATE(
            _ONE, int64, float64, _ROWS, boolean, _ONE, _TWO, _ONE, _ONE, _ONE,
            float64, float64, float64, _OUT, int64[:, ::1],
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_path_extremes),
)  # fmt: skip
