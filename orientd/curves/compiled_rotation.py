"""Quaternions as four numbers, for kernels that Numba compiles into one loop.

The formulas are those of :mod:`orientd.rotation`, which is the reference.  Imported by compiled
kernels only.  Numba keeps what it compiled until the file of the *kernel* changes: who changes this
one while developing deletes the ``__pycache__`` folders beside the kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

from numba import njit

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Function = TypeVar("Function", bound=Callable[..., object])


def inner(function: Function) -> Function:
    """Compile a function as part of the kernels that call it."""
    return cast(Function, njit(error_model="numpy", nogil=True)(function))


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
