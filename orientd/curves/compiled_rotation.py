"""Quaternions as four numbers, for kernels that Numba compiles into one loop.

The formulas are those of :mod:`orientd.rotation`, which is the reference.  Imported by compiled
kernels only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

from orientd.curves.compiled_lanes import Quaternion, Vector, followed, moved, turned_back
from orientd.rotation import Floats

Motion = tuple[Quaternion, Vector, Vector]
"""Orientation, angular velocity and angular acceleration."""

SEAM = 0.25
"""Rad, below which a series replaces the quotient that cancels."""

Function = TypeVar("Function", bound=Callable[..., object])


def inner(function: Function) -> Function:
    """Compile a function as part of the kernels that call it."""
    return cast(Function, njit(error_model="numpy", nogil=True)(function))


@inner
def quaternion(rows: Floats, i: int) -> Quaternion:
    """Return a row of four numbers."""
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@inner
def multiplied(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product of two quaternions."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
    )


@inner
def conjugated(q: Quaternion) -> Quaternion:
    """Return the conjugate of a quaternion."""
    return q[0], -q[1], -q[2], -q[3]


@inner
def relative(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return ``p* q`` as :func:`orientd.rotation.between` does, small turns to all digits."""
    w = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
    sign = math.copysign(1.0, w)
    change = q[0] - sign * p[0], q[1] - sign * p[1], q[2] - sign * p[2], q[3] - sign * p[3]
    _, x, y, z = multiplied(conjugated(p), change)
    return w, x, y, z


@inner
def angle(p: Quaternion, q: Quaternion) -> float:
    """Return the angle between two orientations, in 0 to pi, as :func:`orientd.rotation.angle`."""
    apart, along = 0.0, 0.0
    for k in range(4):
        apart += (q[k] - p[k]) ** 2
        along += (q[k] + p[k]) ** 2
    return 4.0 * math.atan2(math.sqrt(min(apart, along)), math.sqrt(max(apart, along)))


@inner
def exponential(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a half-angle vector."""
    length = math.sqrt(x * x + y * y + z * z)
    sinc = math.sin(length) / length if length > 0.0 else 1.0
    return math.cos(length), sinc * x, sinc * y, sinc * z


@inner
def logarithm(q: Quaternion) -> Vector:
    """Return the half-angle vector of a quaternion with the sign it has."""
    w, x, y, z = q
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        factor = math.atan2(length, w) / length
    elif w < 0.0:
        return math.pi, 0.0, 0.0
    else:
        factor = 1.0 / w if w > 0.0 else 0.0
    return factor * x, factor * y, factor * z


@inner
def turned(q: Quaternion, v: Vector) -> Vector:
    """Return a vector rotated by a unit quaternion."""
    w, x, y, z = q
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + (y * tz - z * ty),
        v[1] + w * ty + (z * tx - x * tz),
        v[2] + w * tz + (x * ty - y * tx),
    )


@inner
def jacobian_factors(square: float) -> tuple[float, float]:
    r"""Return :math:`(1-\cos\theta)/\theta^2` and :math:`(\theta-\sin\theta)/\theta^3`."""
    theta = math.sqrt(square)
    half = 0.5 * theta
    sinc = math.sin(half) / half if half > 0.0 else 1.0
    if theta < SEAM:
        second = (
            1 / 6
            + square * (-1 / 120 + square * (1 / 5040 + square * (-1 / 362880 + square / 39916800)))
        )  # fmt: skip
    else:
        second = (theta - math.sin(theta)) / (theta * square)
    return 0.5 * sinc * sinc, second


@inner
def add_derivative(block: Floats, c: float, v: Vector, after: Quaternion) -> None:
    r"""Add :math:`c\,R(S)^T J_r(v)` to a block, column by column.

    .. math:: J_r(v)\,e = e - a\,v \times e + b\,v \times (v \times e)
    """
    x, y, z = v
    square = x * x + y * y + z * z
    a, b = jacobian_factors(square)
    rest = 1.0 - b * square
    w, e = after[0], (after[1], after[2], after[3])
    first = turned_back(w, e, (rest + b * x * x, b * x * y - a * z, b * x * z + a * y))
    second = turned_back(w, e, (b * x * y + a * z, rest + b * y * y, b * y * z - a * x))
    third = turned_back(w, e, (b * x * z - a * y, b * y * z + a * x, rest + b * z * z))
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
def joined(motion: Motion, axis: Vector, turn: tuple[float, float, float]) -> Motion:
    """Return a motion followed by a turn about a fixed axis.

    Args:
        motion: orientation, velocity and acceleration before it.
        axis: a unit vector.
        turn: the half angle and its two derivatives.
    """
    q, omega, alpha = motion
    c, s = math.cos(turn[0]), math.sin(turn[0])
    e = s * axis[0], s * axis[1], s * axis[2]
    omega, alpha = turned_back(c, e, omega), turned_back(c, e, alpha)
    omega, alpha = moved(omega, alpha, axis, 2.0 * turn[1], 2.0 * turn[2])
    return followed(q, c, e), omega, alpha
