"""One turn about a fixed axis after another, for loops that go to the vector units, by Numba.

Imported by compiled kernels only.  The formulas are those of :mod:`orientd.curves.product`.  None
branches or calls: sine and cosine are polynomials in the squared angle after a reduction to at
most a quarter turn either way.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Function = TypeVar("Function", bound=Callable[..., object])

# Not the reassociation part of it, which would undo the two-part reduction.
_RELAXED = {"contract", "nsz", "nnan", "ninf", "arcp"}

_INVERSE_PI = 0.3183098861837907
_PI_FIRST = 3.1415926218032837
_PI_REST = 3.178650954705639e-08
"""Pi in two parts, the first so short that its multiples are exact."""

# Chebyshev interpolants in z = x^2 on [0, (pi/2)^2], of cos x to 6e-17 and of sin(x)/x to 2e-17.
_C1, _C2, _C3 = -0.4999999999999997, 0.04166666666666388, -0.001388888888877299
_C4, _C5, _C6 = 2.4801587277414926e-05, -2.755731639102575e-07, 2.0876561839933163e-09
_C7, _C8 = -1.1462901901757276e-11, 4.608977003001797e-14
_S1, _S2, _S3 = -0.16666666666666666, 0.008333333333333186, -0.00019841269841208676
_S4, _S5, _S6 = 2.7557319211229606e-06, -2.505210689056952e-08, 1.605894087848656e-10
_S7, _S8 = -7.643026557971632e-13, 2.7215749422983443e-15


def inlined(function: Function) -> Function:
    """Compile a function into the loops that call it."""
    return cast(Function, njit(inline="always")(function))


def vectorised(function: Function) -> Function:
    """Compile a loop with relaxed floating point, for numbers that are finite."""
    return cast(Function, njit(fastmath=_RELAXED, error_model="numpy", nogil=True)(function))


@inlined
def cosine_and_sine(x: float) -> tuple[float, float]:
    """Return both of an angle, to the last digit or two."""
    turns = np.floor(x * _INVERSE_PI + 0.5)
    r = (x - turns * _PI_FIRST) - turns * _PI_REST
    half = 0.5 * turns
    sign = 1.0 - 4.0 * (half - np.floor(half))
    z = r * r
    c = _C4 + z * (_C5 + z * (_C6 + z * (_C7 + z * _C8)))
    s = _S4 + z * (_S5 + z * (_S6 + z * (_S7 + z * _S8)))
    c = 1.0 + z * (_C1 + z * (_C2 + z * (_C3 + z * c)))
    s = r + r * z * (_S1 + z * (_S2 + z * (_S3 + z * s)))
    return sign * c, sign * s


@inlined
def followed(q: Quaternion, c: float, e: Vector) -> Quaternion:
    """Return an orientation followed by the turn *(c, e)*."""
    qw, qx, qy, qz = q
    ex, ey, ez = e
    return (
        qw * c - qx * ex - qy * ey - qz * ez,
        qw * ex + qx * c + qy * ez - qz * ey,
        qw * ey - qx * ez + qy * c + qz * ex,
        qw * ez + qx * ey - qy * ex + qz * c,
    )


@inlined
def turned_back(c: float, e: Vector, v: Vector) -> Vector:
    """Return a vector as it is seen after the turn *(c, e)*."""
    ex, ey, ez = e
    vx, vy, vz = v
    tx = 2.0 * (vy * ez - vz * ey)
    ty = 2.0 * (vz * ex - vx * ez)
    tz = 2.0 * (vx * ey - vy * ex)
    return (
        vx + c * tx + (ty * ez - tz * ey),
        vy + c * ty + (tz * ex - tx * ez),
        vz + c * tz + (tx * ey - ty * ex),
    )


@inlined
def moved(
    omega: Vector, alpha: Vector, axis: Vector, rate: float, curvature: float
) -> tuple[Vector, Vector]:
    """Return the motion before a factor, as seen after it, joined with that of the factor.

    Args:
        omega: angular velocity.
        alpha: its rate.
        axis: of the factor.
        rate: of the factor's angle, rad/s.
        curvature: rad/s^2.
    """
    ax, ay, az = axis
    ox, oy, oz = omega
    px, py, pz = alpha
    nx, ny, nz = rate * ax, rate * ay, rate * az
    return (
        (ox + nx, oy + ny, oz + nz),
        (
            px + curvature * ax + (oy * nz - oz * ny),
            py + curvature * ay + (oz * nx - ox * nz),
            pz + curvature * az + (ox * ny - oy * nx),
        ),
    )
