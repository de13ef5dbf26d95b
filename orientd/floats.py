"""Quaternion arithmetic on plain floats, for code that runs in every cycle.

One quaternion takes 1-3 us here and 100 us in NumPy.  Quaternions are ``(w, x, y, z)``, Hamilton.
:mod:`orientd.rotation` has the same functions for arrays and is the reference in the tests.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

from orientd.driver import Quaternion, Vector3


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the Hamilton product *p q*."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """Return the inverse of a unit quaternion."""
    w, x, y, z = q
    return (w, -x, -y, -z)


def normalize(q: Quaternion) -> Quaternion:
    """Return *q* divided by its norm, which must not be zero."""
    w, x, y, z = q
    s = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return (w * s, x * s, y * s, z * s)


def exp(r: Vector3) -> Quaternion:
    """Return the unit quaternion of the rotation vector *r*, in rad."""
    x, y, z = r
    angle = sqrt(x * x + y * y + z * z)
    # sin(a/2)/a tends to 1/2; a denormal angle leaves nothing to divide by.
    s = sin(0.5 * angle) / angle if angle > 1e-150 else 0.5
    return (cos(0.5 * angle), s * x, s * y, s * z)


def log(q: Quaternion) -> Vector3:
    """Return the shorter rotation vector of the unit quaternion *q*, in rad."""
    w, x, y, z = q
    n = sqrt(x * x + y * y + z * z)
    if n < 1e-150:
        return (2.0 * x, 2.0 * y, 2.0 * z) if w >= 0.0 else (-2.0 * x, -2.0 * y, -2.0 * z)
    s = 2.0 * atan2(n, w) / n if w >= 0.0 else -2.0 * atan2(n, -w) / n
    return (s * x, s * y, s * z)


def difference(p: Quaternion, q: Quaternion) -> Vector3:
    """Return the rotation vector of ``p^-1 q``: how to turn from *p* to *q*, in p's frame, rad."""
    # multiply(conjugate(p), q) and log in one piece: it runs every cycle.
    a, b, c, d = p
    e, f, g, h = q
    w = a * e + b * f + c * g + d * h
    x = a * f - b * e - c * h + d * g
    y = a * g + b * h - c * e - d * f
    z = a * h - b * g + c * f - d * e
    n = sqrt(x * x + y * y + z * z)
    if n < 1e-150:
        return log((w, x, y, z))
    s = 2.0 * atan2(n, w) / n if w >= 0.0 else -2.0 * atan2(n, -w) / n
    return (s * x, s * y, s * z)


def rotate(q: Quaternion, v: Vector3) -> Vector3:
    """Return the vector *v* in the frame of *q* in the world: ``R(q) v``."""
    return rotate_back(conjugate(q), v)


def rotate_back(q: Quaternion, v: Vector3) -> Vector3:
    """Return the world vector *v* in the frame of *q*: ``R(q)^T v``."""
    w, x, y, z = q
    a, b, c = v
    # v - w t + u x t with t = 2 u x v, the conjugate's rotation.
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a - w * tx + y * tz - z * ty,
        b - w * ty + z * tx - x * tz,
        c - w * tz + x * ty - y * tx,
    )


def combine(a: Vector3, s: float, b: Vector3, t: float) -> Vector3:
    """Return ``s a + t b``."""
    return (a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t)


def plus(a: Vector3, b: Vector3, factor: float) -> Vector3:
    """Return ``a + factor b``."""
    return (a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2])


def dot(a: Vector3, b: Vector3) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector3, b: Vector3) -> Vector3:
    """Return the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def norm(v: Vector3) -> float:
    """Return the Euclidean length of *v*."""
    x, y, z = v
    return sqrt(x * x + y * y + z * z)
