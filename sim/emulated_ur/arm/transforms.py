"""Rigid transforms and UR poses ``[x, y, z, rx, ry, rz]`` in plain Python floats.

A transform is twelve numbers, the upper three rows of the homogeneous matrix, row by row.  A pose
is position in metres and a rotation vector in radians, as a UR controller writes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Transform = tuple[float, ...]
Pose = tuple[float, ...]
Vector = tuple[float, float, float]


def multiply(a: Transform, b: Transform) -> Transform:
    """Return the transform that applies *b* first, then *a*."""
    a00, a01, a02, a03, a10, a11, a12, a13, a20, a21, a22, a23 = a
    b00, b01, b02, b03, b10, b11, b12, b13, b20, b21, b22, b23 = b
    return (
        a00 * b00 + a01 * b10 + a02 * b20,
        a00 * b01 + a01 * b11 + a02 * b21,
        a00 * b02 + a01 * b12 + a02 * b22,
        a00 * b03 + a01 * b13 + a02 * b23 + a03,
        a10 * b00 + a11 * b10 + a12 * b20,
        a10 * b01 + a11 * b11 + a12 * b21,
        a10 * b02 + a11 * b12 + a12 * b22,
        a10 * b03 + a11 * b13 + a12 * b23 + a13,
        a20 * b00 + a21 * b10 + a22 * b20,
        a20 * b01 + a21 * b11 + a22 * b21,
        a20 * b02 + a21 * b12 + a22 * b22,
        a20 * b03 + a21 * b13 + a22 * b23 + a23,
    )


def inverse(a: Transform) -> Transform:
    """Return the inverse of a rigid transform."""
    a00, a01, a02, a03, a10, a11, a12, a13, a20, a21, a22, a23 = a
    return (
        a00, a10, a20, -(a00 * a03 + a10 * a13 + a20 * a23),
        a01, a11, a21, -(a01 * a03 + a11 * a13 + a21 * a23),
        a02, a12, a22, -(a02 * a03 + a12 * a13 + a22 * a23),
    )  # fmt: skip


def rotated(vector: Sequence[float], turn: Sequence[float]) -> Vector:
    """Return *vector* rotated by the rotation vector *turn*."""
    rows, (x, y, z) = from_pose((0.0, 0.0, 0.0, *turn)), vector
    a, b, c = (rows[at] * x + rows[at + 1] * y + rows[at + 2] * z for at in (0, 4, 8))
    return (a, b, c)


def moved(a: Transform, shift: Sequence[float], turn: Sequence[float]) -> Transform:
    """Return *a* shifted, and turned about its own origin; both in base coordinates."""
    turned = multiply(from_pose((0.0, 0.0, 0.0, *turn)), a)
    x, y, z = (p + d for p, d in zip(a[3::4], shift, strict=True))
    return (*turned[0:3], x, *turned[4:7], y, *turned[8:11], z)


def from_pose(pose: Sequence[float]) -> Transform:
    """Return the transform of a pose; its rotation vector may be of any length (Rodrigues)."""
    x, y, z, rx, ry, rz = pose
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    if angle < 1e-12:
        # First order: the second-order term is below the last bit of 1.
        return (1.0, -rz, ry, x, rz, 1.0, -rx, y, -ry, rx, 1.0, z)
    ux, uy, uz = rx / angle, ry / angle, rz / angle
    s = math.sin(angle)
    half = math.sin(0.5 * angle)
    v = 2.0 * half * half
    c = math.cos(angle)
    return (
        c + ux * ux * v, ux * uy * v - uz * s, ux * uz * v + uy * s, x,
        uy * ux * v + uz * s, c + uy * uy * v, uy * uz * v - ux * s, y,
        uz * ux * v - uy * s, uz * uy * v + ux * s, c + uz * uz * v, z,
    )  # fmt: skip


def to_pose(a: Transform) -> Pose:
    """Return the pose of a transform; its rotation vector is at most pi long.

    The quaternion comes from the largest of its four components, which is precise for every
    rotation, including half turns.
    """
    m00, m01, m02, x, m10, m11, m12, y, m20, m21, m22, z = a
    trace = m00 + m11 + m22
    largest = max(trace, m00, m11, m22)
    if largest == trace:
        w, i, j, k = 1.0 + trace, m21 - m12, m02 - m20, m10 - m01
    elif largest == m00:
        w, i, j, k = m21 - m12, 1.0 + m00 - m11 - m22, m01 + m10, m02 + m20
    elif largest == m11:
        w, i, j, k = m02 - m20, m01 + m10, 1.0 - m00 + m11 - m22, m12 + m21
    else:
        w, i, j, k = m10 - m01, m02 + m20, m12 + m21, 1.0 - m00 - m11 + m22
    sine = math.sqrt(i * i + j * j + k * k)
    if sine == 0.0:
        return (x, y, z, 0.0, 0.0, 0.0)
    if w < 0.0:
        w, i, j, k = -w, -i, -j, -k
    scale = 2.0 * math.atan2(sine, w) / sine
    return (x, y, z, i * scale, j * scale, k * scale)


def rotation_between(a: Transform, b: Transform) -> Vector:
    """Return the rotation vector, in base coordinates, that turns *a* onto *b*; rad."""
    _, _, _, rx, ry, rz = to_pose(
        multiply(
            (*b[0:3], 0.0, *b[4:7], 0.0, *b[8:11], 0.0),
            inverse((*a[0:3], 0.0, *a[4:7], 0.0, *a[8:11], 0.0)),
        )
    )
    return (rx, ry, rz)
