"""The survey of a core, compiled by Numba: for curves of cubic factors.

Imported by :mod:`orientd.planner.fast` only.  The reference is :mod:`orientd.planner.survey`.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.compiled import fill
from orientd.curves.compiled_rotation import inner
from orientd.planner.compiled_differences import BLOCK, keep_last, new_block, put, see
from orientd.planner.differences import HISTORY
from orientd.planner.fast import LookAt, SurveyOf
from orientd.planner.survey import GAP, HOT, MARGIN, PIECES, SHARES
from orientd.rotation import Floats


@inner
def _instants(breaks: Floats, rate: float, duration: float, instants: Floats) -> int:
    """Write instants on either side of every break and between them, and return how many."""
    origin = breaks[0]
    few = len(breaks) < PIECES
    i, j, count = 0, 0, 0
    before = -1.0
    # Those of the curve, and of as many equal pieces where it has but few, in order.
    while i < len(breaks) or (few and j <= PIECES):
        own = (breaks[i] - origin) / rate if i < len(breaks) else math.inf
        other = duration * j / PIECES if few and j <= PIECES else math.inf
        here = min(own, other)
        i += own <= other
        j += few and other <= own
        if not 0.0 <= here <= duration:
            continue
        if here > before >= 0.0:
            for share in SHARES:
                instants[count] = before + (here - before) * share
                count += 1
        before = here
    return count


@inner
def _size(x: float, y: float, z: float) -> float:
    return math.sqrt(x * x + y * y + z * z)


@inner
def _share(x: float, y: float, z: float, limits: Floats) -> float:
    """Return a rate as a share of its limits, of the norm or of an axis."""
    share: float = max(
        _size(x, y, z) / limits[0], abs(x) / limits[1], abs(y) / limits[2], abs(z) / limits[3]
    )
    return share


def _survey(
    breaks: Floats, table: Floats, rate: float, duration: float, period: float, limits: Floats,
    with_ends: bool, spots: Floats,
) -> tuple[float, int]:  # fmt: skip
    """Return by which factor a core should take longer, and write where that is decided.

    Args:
        breaks: of its curve, s, shape ``(S + 1,)``.
        table: of its curve, shape ``(25, S)``.
        rate: of the curve.
        duration: of the core, s.
        period: of the device, s.
        limits: of the norm and the components, shape ``(3, 4)``.
        with_ends: whether the first instant and the last are such places.
        spots: receives the places, from 0 to 1, in order; shape ``(many, 2)``.

    Returns:
        The factor, and how many places there are.
    """
    most = len(SHARES) * (len(breaks) + PIECES + 1)
    instants, factors = np.empty(most), np.empty(most)
    count = _instants(breaks, rate, duration, instants)
    times, out = np.empty(count), np.empty((10, count))
    for i in range(count):
        times[i] = min(max(breaks[0] + rate * instants[i], breaks[0]), breaks[-1])
    fill(times, breaks, table, 0.0, out)
    largest = 0.0
    for i in range(count):
        factor = _share(rate * out[4, i], rate * out[5, i], rate * out[6, i], limits[0])
        scale = rate * rate
        bend = _share(scale * out[7, i], scale * out[8, i], scale * out[9, i], limits[1])
        factor = max(factor, math.sqrt(bend))
        if i:
            # What lies within a period counts as a step of the acceleration over one.
            step = max(instants[i] - instants[i - 1], period)
            twist = _share(
                scale * (out[7, i] - out[7, i - 1]),
                scale * (out[8, i] - out[8, i - 1]),
                scale * (out[9, i] - out[9, i - 1]),
                limits[2],
            )
            factor = max(factor, math.pow(twist / step, 1.0 / 3.0))
        factors[i] = factor
        largest = max(largest, factor)
    found = 0
    if with_ends:
        spots[0, 0] = spots[0, 1] = 0.0
        found = 1
    for i in range(count):
        if factors[i] >= HOT * largest:
            begin = instants[max(i - 1, 0)] / duration
            end = instants[min(i + 1, count - 1)] / duration
            found = _put_spot(begin, end, found, spots)
    if with_ends:
        found = _put_spot(1.0, 1.0, found, spots)
    return largest, found


@inner
def _put_spot(begin: float, end: float, count: int, spots: Floats) -> int:
    """Add a place behind those before it, or make the last one longer; return how many."""
    if count and begin <= spots[count - 1, 1]:
        spots[count - 1, 1] = max(spots[count - 1, 1], end)
        return count
    spots[count, 0], spots[count, 1] = begin, end
    return count + 1


@inner
def _excess(
    first: int, last: int, final: int, breaks: Floats, table: Floats, rate: float, duration: float,
    period: float, limits: Floats, start_held: bool, end_held: bool,
) -> float:  # fmt: skip
    """Return by which factor a core should take longer, from some of its records."""
    with_axes = bool(np.min(limits[:, 1:]) < math.inf)
    largest, places = np.zeros((3, 4)), np.zeros((3, 4), dtype=np.int64)
    before = HISTORY if first == 0 and start_held else 0
    after = HISTORY if last == final and end_held else 0
    block, known, read = new_block(), 0, first - before
    end = last + 1 + after
    while read < end:
        count = min(BLOCK, known + end - read)
        times, out = np.empty(count - known), np.empty((10, count - known))
        for i in range(len(times)):
            t = min(period * min(max(read + i, first), last), duration)
            times[i] = min(max(breaks[0] + rate * t, breaks[0]), breaks[-1])
        fill(times, breaks, table, 0.0, out)
        for i in range(len(times)):
            put(block, known + i, out[0, i], out[1, i], out[2, i], out[3, i])
        read += len(times)
        see(block, count, 0, with_axes, 0, largest, places)
        known = keep_last(block, count)
    factor, unit = 0.0, 1.0
    for order in range(3):
        unit *= period
        share = 0.0
        for c in range(4):
            share = max(share, math.sqrt(largest[order, c]) / unit / limits[order, c])
        factor = max(factor, math.pow(share, 1.0 / (order + 1.0)))
    return factor


def _look(
    spots: Floats, final: int, breaks: Floats, table: Floats, rate: float, duration: float,
    period: float, limits: Floats, start_held: bool, end_held: bool,
) -> float:  # fmt: skip
    """Return by which factor a core should take longer, from its records at some places.

    Args:
        spots: the places, from 0 to 1, in order, shape ``(n, 2)``.
        final: the last record of the core; the first one is 0.
        breaks: as in :func:`_survey`, like all that have the same name.
        table: likewise.
        rate: likewise.
        duration: likewise.
        period: likewise.
        limits: likewise.
        start_held: whether the device holds before the first record.
        end_held: whether it holds after the last one.
    """
    factor = 0.0
    i = 0
    while i < len(spots):
        first = max(math.floor(spots[i, 0] * final) - MARGIN, 0)
        last = first
        # What is near costs less than another look.
        while i < len(spots) and math.floor(spots[i, 0] * final) - MARGIN <= last + GAP:
            last = max(last, min(math.ceil(spots[i, 1] * final) + MARGIN, final))
            i += 1
        found = _excess(
            first, last, final, breaks, table, rate, duration, period, limits, start_held, end_held
        )
        factor = max(factor, found)
    return factor


_ONE, _TWO = (types.Array(float64, n, "C", readonly=True) for n in (1, 2))
_FOUND = types.Tuple((float64, int64))  # type: ignore[no-untyped-call]  # Numba's own

survey: SurveyOf = cast(
    SurveyOf,
    njit(
        _FOUND(_ONE, _TWO, float64, float64, float64, _TWO, boolean, float64[:, ::1]),
        error_model="numpy", nogil=True, cache=True,
    )(_survey),
)  # fmt: skip
look: LookAt = cast(
    LookAt,
    njit(
        float64(
            _TWO, int64, _ONE, _TWO, float64, float64, float64, _TWO, boolean, boolean
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_look),
)  # fmt: skip
