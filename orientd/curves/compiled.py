"""The cumulative product of up to three cubic factors, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only, in the background: importing it compiles, or loads
what an earlier process compiled.  The formulas are those of :mod:`orientd.curves.product`,
which is the reference; here they are arranged for the vector units of the processor:

* instants are grouped into runs inside one span.  A long run is one loop whose constants are
  scalars and whose results go straight to contiguous rows;
* short runs are collected, constants and all, in a tile that one loop of fixed length works off;
* neither loop branches or calls (:mod:`orientd.curves.compiled_lanes`).

Only the loops use relaxed floating point; the search for spans must see what is not a number.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import float64, int64, njit, types, uint64

from orientd.curves.compiled_lanes import (
    Quaternion,
    Vector,
    cosine_and_sine,
    followed,
    inlined,
    moved,
    turned_back,
    vectorised,
)
from orientd.curves.compiled_rotation import inner
from orientd.curves.fast import Fill
from orientd.rotation import Floats

TILE = 64
LONG = 32
STRIDE = 64
ROWS = 25
"""Rows of the table: base quaternion, then per factor four coefficients and the axis."""

Factor = tuple[float, float, float, float, float, float, float]
"""Taylor coefficients of the half angle, the factorials divided out, and the unit axis."""
State = tuple[Quaternion, Vector, Vector]


@inlined
def _turn(t: float, factor: Factor) -> tuple[float, Vector, float, float]:
    """Return the quaternion of a factor, and twice the derivatives of its half angle."""
    a0, a1, a2, a3, ax, ay, az = factor
    c, s = cosine_and_sine(a0 + t * (a1 + t * (a2 + t * a3)))
    rate = 2.0 * (a1 + t * (2.0 * a2 + t * (3.0 * a3)))
    return c, (s * ax, s * ay, s * az), rate, 4.0 * a2 + t * (12.0 * a3)


@inlined
def _sampled(t: float, base: Quaternion, f: Factor, g: Factor, h: Factor) -> State:
    # The first factor's velocity and acceleration have its axis, which is turned for both.
    c, e, rate, curvature = _turn(t, f)
    q = followed(base, c, e)
    c, e, next_rate, next_curvature = _turn(t, g)
    q = followed(q, c, e)
    x, y, z = turned_back(c, e, (f[4], f[5], f[6]))
    before = (rate * x, rate * y, rate * z)
    change = (curvature * x, curvature * y, curvature * z)
    omega, alpha = moved(before, change, (g[4], g[5], g[6]), next_rate, next_curvature)
    c, e, rate, curvature = _turn(t, h)
    q = followed(q, c, e)
    omega, alpha = turned_back(c, e, omega), turned_back(c, e, alpha)
    omega, alpha = moved(omega, alpha, (h[4], h[5], h[6]), rate, curvature)
    return q, omega, alpha


@vectorised
def _fill_run(
    times: Floats, first: int, end: int, table: Floats, breaks: Floats, span: int, out: Floats
) -> None:
    """Work off instants *first* to *end*, all of them inside one span."""
    start = breaks[span]
    base = (table[0, span], table[1, span], table[2, span], table[3, span])
    f = (
        table[4, span], table[5, span], table[6, span], table[7, span],
        table[8, span], table[9, span], table[10, span],
    )  # fmt: skip
    g = (
        table[11, span], table[12, span], table[13, span], table[14, span],
        table[15, span], table[16, span], table[17, span],
    )  # fmt: skip
    h = (
        table[18, span], table[19, span], table[20, span], table[21, span],
        table[22, span], table[23, span], table[24, span],
    )  # fmt: skip
    w, x, y, z = out[0], out[1], out[2], out[3]
    ox, oy, oz = out[4], out[5], out[6]
    px, py, pz = out[7], out[8], out[9]
    for i in range(uint64(first), uint64(end)):
        q, omega, alpha = _sampled(times[i] - start, base, f, g, h)
        w[i], x[i], y[i], z[i] = q
        ox[i], oy[i], oz[i] = omega
        px[i], py[i], pz[i] = alpha


@vectorised
def _fill_tile(tile: Floats) -> None:
    """Work off a tile: rows of times since the span began, then constants, then results.

    Being one array with rows of fixed length, it needs no checks of whether rows overlap.
    """
    for i in range(uint64(TILE)):
        q, omega, alpha = _sampled(
            tile[i],
            (tile[1 * TILE + i], tile[2 * TILE + i], tile[3 * TILE + i], tile[4 * TILE + i]),
            (
                tile[5 * TILE + i], tile[6 * TILE + i], tile[7 * TILE + i], tile[8 * TILE + i],
                tile[9 * TILE + i], tile[10 * TILE + i], tile[11 * TILE + i],
            ),
            (
                tile[12 * TILE + i], tile[13 * TILE + i], tile[14 * TILE + i], tile[15 * TILE + i],
                tile[16 * TILE + i], tile[17 * TILE + i], tile[18 * TILE + i],
            ),
            (
                tile[19 * TILE + i], tile[20 * TILE + i], tile[21 * TILE + i], tile[22 * TILE + i],
                tile[23 * TILE + i], tile[24 * TILE + i], tile[25 * TILE + i],
            ),
        )  # fmt: skip
        tile[26 * TILE + i], tile[27 * TILE + i] = q[0], q[1]
        tile[28 * TILE + i], tile[29 * TILE + i] = q[2], q[3]
        tile[30 * TILE + i], tile[31 * TILE + i], tile[32 * TILE + i] = omega
        tile[33 * TILE + i], tile[34 * TILE + i], tile[35 * TILE + i] = alpha


@inner
def _inside(times: Floats, first: int, start: float, end: float) -> int:
    """Return how many of the next instants are in a span, in a loop without a way out."""
    found = 0
    for i in range(STRIDE):
        t = times[uint64(first + i)]
        found += int((t >= start) & (t < end))
    return found


@inner
def _unload(tile: Floats, count: int, first: int, out: Floats) -> None:
    """Work off a tile and copy what is wanted of it to the output from place *first* on."""
    _fill_tile(tile)
    for row in range(10):
        begin = (ROWS + 1 + row) * TILE
        for i in range(count):
            out[row, first + i] = tile[begin + i]


@inlined
def _span_of(t: float, breaks: Floats) -> int:
    """Return the span that an instant inside the domain is in, the last one closed at its end."""
    low, high = 0, len(breaks) - 2
    while low < high:
        middle = (low + high + 1) // 2
        if breaks[middle] <= t:
            low = middle
        else:
            high = middle - 1
    return low


def _fill(times: Floats, breaks: Floats, table: Floats, slack: float, out: Floats) -> int:
    """Write orientation, velocity and acceleration at instants in any order.

    Args:
        times: instants in seconds, shape ``(n,)``.
        breaks: ends of the spans, shape ``(S + 1,)``.
        table: constants of the spans, shape ``(25, S)``.
        slack: how far outside the domain an instant may be, in seconds.
        out: receives the samples, shape ``(10, n)``.

    Returns:
        The place of the first instant that is outside the domain, or -1 if none is.
    """
    count = len(times)
    first, last = breaks[0], breaks[-1]
    tile = np.zeros((ROWS + 11) * TILE)
    held = 0
    span = 0
    i = 0
    while i < count:
        t = times[i]
        if not (breaks[span] <= t < breaks[span + 1]):
            if not (first - slack <= t <= last + slack):
                return i
            t = min(max(t, first), last)
            if span + 2 < len(breaks) and breaks[span + 1] <= t < breaks[span + 2]:
                span += 1
            else:
                span = _span_of(t, breaks)
        start, end = breaks[span], breaks[span + 1]
        stop = i + 1
        while stop + STRIDE <= count and _inside(times, stop, start, end) == STRIDE:
            stop += STRIDE
        while stop < count and start <= times[stop] < end:
            stop += 1
        if stop - i >= LONG and t == times[i]:
            if held:
                _unload(tile, held, i - held, out)
                held = 0
            _fill_run(times, i, stop, table, breaks, span, out)
            i = stop
            continue
        while i < stop:
            taken = min(stop - i, TILE - held)
            tile[held] = t - start
            for k in range(1, taken):
                tile[held + k] = times[i + k] - start
            for row in range(ROWS):
                constant = table[row, span]
                place = (row + 1) * TILE + held
                for k in range(taken):
                    tile[place + k] = constant
            held += taken
            i += taken
            if i < stop:
                t = times[i]
            if held == TILE:
                _unload(tile, held, i - held, out)
                held = 0
    if held:
        _unload(tile, held, count - held, out)
    return -1


_INPUT = types.Array(float64, 1, "C", readonly=True)
_TABLE = types.Array(float64, 2, "C", readonly=True)
_SIGNATURE = int64(_INPUT, _INPUT, _TABLE, float64, float64[:, ::1])

fill: Fill = cast(Fill, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_fill))
