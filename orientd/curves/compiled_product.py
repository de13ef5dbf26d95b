"""The cumulative product of any number of factors, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The formulas are those of
:mod:`orientd.curves.product`, which is the reference.  Curves of at most three cubic factors have
:mod:`orientd.curves.compiled`, which is several times as fast; this one serves the quintic joins of
the planner, of which a few hundred samples are wanted at a time.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import float64, int64, njit, types

from orientd.curves.compiled_rotation import (
    Quaternion,
    Vector,
    conjugated,
    inner,
    multiplied,
    turned,
)
from orientd.curves.fast import FillProduct
from orientd.rotation import Floats

Motion = tuple[Quaternion, Vector, Vector]


@inner
def raise_bernstein(weights: Floats, degree: int, u: float) -> None:
    """Replace the Bernstein polynomials of one degree at *u* by those of the next, *degree*."""
    weights[degree] = u * weights[degree - 1]
    for j in range(degree - 1, 0, -1):
        weights[j] = u * weights[j - 1] + (1.0 - u) * weights[j]
    weights[0] *= 1.0 - u


@inner
def joined(motion: Motion, axis: Vector, turn: tuple[float, float, float]) -> Motion:
    """Return a motion followed by a turn about a fixed axis.

    Args:
        motion: orientation, velocity and acceleration before it.
        axis: a unit vector.
        turn: the half angle and its two derivatives.
    """
    q, omega, alpha = motion
    ax, ay, az = axis
    s = math.sin(turn[0])
    e = math.cos(turn[0]), s * ax, s * ay, s * az
    rate, curvature = 2.0 * turn[1], 2.0 * turn[2]
    nx, ny, nz = rate * ax, rate * ay, rate * az
    back = conjugated(e)
    ox, oy, oz = turned(back, omega)
    px, py, pz = turned(back, alpha)
    return (
        multiplied(q, e),
        (ox + nx, oy + ny, oz + nz),
        (
            px + curvature * ax + (oy * nz - oz * ny),
            py + curvature * ay + (oz * nx - ox * nz),
            pz + curvature * az + (ox * ny - oy * nx),
        ),
    )


@inner
def _sum(coefficients: Floats, weights: Floats, count: int) -> float:
    total = 0.0
    for j in range(count):
        total += coefficients[j] * weights[j]
    return total


def _fill(
    times: Floats, breaks: Floats, base: Floats, axes: Floats, lengths: Floats,
    values: Floats, rates: Floats, curvatures: Floats, slack: float, out: Floats,
) -> int:  # fmt: skip
    """Write orientation, velocity and acceleration at instants in any order.

    Args:
        times: instants in seconds, shape ``(n,)``.
        breaks: ends of the spans, shape ``(S + 1,)``.
        base: the quaternions before the product of each span, shape ``(4, S)``.
        axes: unit axes of the factors, shape ``(m, 3, S)``.
        lengths: their half angles, shape ``(m, S)``.
        values: Bernstein coefficients of the basis functions, shape ``(S, m, m + 1)``.
        rates: those of their derivatives, shape ``(S, m, m)``.
        curvatures: those of their second derivatives, shape ``(S, m, m - 1)``.
        slack: how far outside the domain an instant may be, in seconds.
        out: receives the samples, shape ``(10, n)``.

    Returns:
        The place of the first instant that is outside the domain, or -1 if none is.
    """
    factors = len(lengths)
    first, last = breaks[0], breaks[-1]
    low, middle, high = np.empty(factors + 1), np.empty(factors + 1), np.empty(factors + 1)
    for i in range(len(times)):
        t = times[i]
        if not (first - slack <= t <= last + slack):
            return i
        t = min(max(t, first), last)
        span = min(int(np.searchsorted(breaks, t, side="right")) - 1, len(breaks) - 2)
        u = (t - breaks[span]) / (breaks[span + 1] - breaks[span])
        low[0] = 1.0
        for degree in range(1, factors - 1):
            raise_bernstein(low, degree, u)
        middle[: factors - 1] = low[: factors - 1]
        raise_bernstein(middle, factors - 1, u)
        high[:factors] = middle[:factors]
        raise_bernstein(high, factors, u)
        q = (base[0, span], base[1, span], base[2, span], base[3, span])
        motion = q, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for j in range(factors):
            length = lengths[j, span]
            turn = (
                length * _sum(values[span, j], high, factors + 1),
                length * _sum(rates[span, j], middle, factors),
                length * _sum(curvatures[span, j], low, factors - 1),
            )
            axis = (axes[j, 0, span], axes[j, 1, span], axes[j, 2, span])
            motion = joined(motion, axis, turn)
        q, omega, alpha = motion
        out[0, i], out[1, i], out[2, i], out[3, i] = q
        out[4, i], out[5, i], out[6, i] = omega
        out[7, i], out[8, i], out[9, i] = alpha
    return -1


_ONE, _TWO, _THREE = (types.Array(float64, n, "C", readonly=True) for n in (1, 2, 3))
_SIGNATURE = int64(_ONE, _ONE, _TWO, _THREE, _TWO, _THREE, _THREE, _THREE, float64, float64[:, ::1])

fill: FillProduct = cast(
    FillProduct, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_fill)
)
