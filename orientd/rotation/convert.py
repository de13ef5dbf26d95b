"""Conversions between unit quaternions and every other form of a rotation orientd accepts.

The only place, apart from codecs, where another component order than ``(w, x, y, z)`` appears.
SciPy is imported only when one of its objects is needed.  Four bare numbers do not tell
which one is the scalar.  Users therefore give a ``scipy.spatial.transform.Rotation``, a
:class:`Quaternion`, or an array with its order.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from orientd.errors import OrientdError
from orientd.rotation.quaternion import Floats, check_unit, components, exp_half, multiply, rotate

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def to_matrix(q: ArrayLike) -> Floats:
    """Return the rotation matrices of unit quaternions, for column vectors.

    Nielson (1993) writes points as rows, so his eq. (9) is the transpose of this.

    Returns:
        Matrices, shape ``(..., 3, 3)``, with ``matrix @ p`` the rotated point.

    Raises:
        ValueError: a norm is not 1 within 1e-6.
    """
    q = check_unit(q)
    # The columns are the rotated axes.
    return np.swapaxes(rotate(q[..., None, :], np.eye(3)), -1, -2)


def from_matrix(matrix: ArrayLike, tolerance: float = 1e-6) -> Floats:
    """Return the unit quaternions of rotation matrices, by the largest component.

    Of ``w^2, x^2, y^2, z^2``, each a sum of diagonal elements, the largest (at least 1/4) gives
    its component by a square root.  The other three follow by division, so no digits are lost at
    any angle.  This is the algorithm after eq. 9 of Nielson (1993), there for the transposed
    matrix.

    Args:
        matrix: rotation matrices for column vectors, shape ``(..., 3, 3)``.
        tolerance: largest allowed entry of ``matrix @ matrix.T - I``.

    Returns:
        Unit quaternions, shape ``(..., 4)``; the largest component is positive.

    Raises:
        ValueError: the shape is wrong, or a matrix is not orthogonal with determinant +1.
    """
    m = np.asarray(matrix, dtype=np.float64)
    if m.ndim < 2 or m.shape[-2:] != (3, 3):
        raise ValueError(f"matrix must have shape (..., 3, 3), got {m.shape}")
    defect = np.abs(m @ np.swapaxes(m, -1, -2) - np.eye(3))
    if not np.all(defect <= tolerance):
        raise ValueError(
            f"matrix must be orthogonal within {tolerance:g}, got an error of {defect.max():.3g}"
        )
    if not np.all(np.linalg.det(m) > 0.0):
        raise ValueError("matrix must be a rotation, got a reflection (determinant -1)")
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Row c of the symmetric matrix 4 q q^T is 4 q_c q.
    outer: Floats = np.empty((*m.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1.0 + xx + yy + zz
    outer[..., 1, 1] = 1.0 + xx - yy - zz
    outer[..., 2, 2] = 1.0 - xx + yy - zz
    outer[..., 3, 3] = 1.0 - xx - yy + zz
    outer[..., 0, 1] = outer[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    outer[..., 0, 2] = outer[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    outer[..., 0, 3] = outer[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    outer[..., 1, 2] = outer[..., 2, 1] = m[..., 0, 1] + m[..., 1, 0]
    outer[..., 1, 3] = outer[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    outer[..., 2, 3] = outer[..., 3, 2] = m[..., 1, 2] + m[..., 2, 1]
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    q: Floats = row / np.sqrt(np.sum(row * row, axis=-1, keepdims=True))
    return q


def from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> Floats:
    """Return the unit quaternions of turns about axes.

    Args:
        axis: axes, shape ``(..., 3)``, of any length but zero.
        angle: angles in radians, broadcast against the leading axes of *axis*.  Turns beyond ``2
            pi`` change only the sign of the result.

    Returns:
        Unit quaternions, shape ``(..., 4)``.

    Raises:
        ValueError: an axis is zero or not finite.
    """
    axis = components(axis, 3, "axis")
    largest = np.max(np.abs(axis), axis=-1, keepdims=True)
    if not np.all(np.isfinite(largest) & (largest > 0.0)):
        raise ValueError("axis must be finite and not zero")
    unit = axis / largest
    unit = unit / np.sqrt(np.sum(unit * unit, axis=-1, keepdims=True))
    return exp_half(0.5 * np.asarray(angle, dtype=np.float64)[..., None] * unit)


def _axes(axes: str) -> tuple[list[int], bool]:
    is_intrinsic = axes.isupper()
    letters = axes.lower()
    repeated = any(a == b for a, b in pairwise(letters))
    if (
        not 1 <= len(axes) <= 3
        or not set(letters) <= set("xyz")
        or repeated
        or (not is_intrinsic and not axes.islower())
    ):
        raise ValueError(
            "axes must be one to three of the letters xyz (about fixed axes) or XYZ (about axes "
            f"that turn with the body), no two neighbours the same, got {axes!r}"
        )
    return ["xyz".index(letter) for letter in letters], is_intrinsic


def from_euler(axes: str, angles: ArrayLike) -> Floats:
    """Return the unit quaternions of successive turns about coordinate axes.

    Args:
        axes: one to three letters, lower case about fixed axes (extrinsic), upper case about axes
            that turn with the body (intrinsic), as in SciPy; ``"ZYX"`` is yaw, pitch, roll.
        angles: angles in radians, in the order of *axes*, shape ``(..., len(axes))``.

    Returns:
        Unit quaternions, shape ``(..., 4)``.

    Raises:
        ValueError: *axes* is not such a string, or *angles* does not fit it.
    """
    order, is_intrinsic = _axes(axes)
    values = np.asarray(angles, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] != len(order):
        raise ValueError(
            f"angles must have {len(order)} values in its last axis for axes={axes!r}, "
            f"got shape {values.shape}"
        )
    if not np.all(np.isfinite(values)):
        raise ValueError("angles must be finite")
    q: Floats = np.zeros((*values.shape[:-1], 4))
    q[..., 0] = 1.0
    for place, axis in enumerate(order):
        turn = from_axis_angle(np.eye(3)[axis], values[..., place])
        q = multiply(q, turn) if is_intrinsic else multiply(turn, q)
    return q


def to_euler(q: ArrayLike, axes: str) -> Floats:
    """Return the angles of successive turns about three coordinate axes.

    Two arc tangents of the quaternion's components give the sum and difference of the first and
    third angle (Bernardes and Viollet, 2022).  This works for any order of axes without a table.

    Args:
        q: unit quaternions, shape ``(..., 4)``.
        axes: three letters as in :func:`from_euler`.

    Returns:
        Angles in radians in the order of *axes*, shape ``(..., 3)``: the first and third in ``[-pi,
        pi]``, the second in ``[0, pi]`` for orders like ``zxz`` and in ``[-pi/2, pi/2]`` otherwise.
        In gimbal lock, the first and third turn are about the same line.  The third angle of an
        extrinsic order, or the first of an intrinsic one, then takes the whole turn and the other
        one is zero.

    Raises:
        ValueError: *axes* does not name three turns, or *q* is not a unit quaternion.
    """
    order, is_intrinsic = _axes(axes)
    if len(order) != 3:
        raise ValueError(f"axes must have three letters to decompose a rotation, got {axes!r}")
    q = check_unit(q)
    i, j, k = order if not is_intrinsic else order[::-1]
    is_proper = i == k
    if is_proper:
        k = 3 - i - j
    sign = float((i - j) * (j - k) * (k - i) // 2)
    w, xyz = q[..., 0], q[..., 1:]
    if is_proper:
        a, b, c, d = w, xyz[..., i], xyz[..., j], sign * xyz[..., k]
    else:
        a = w - xyz[..., j]
        b = xyz[..., i] + sign * xyz[..., k]
        c = xyz[..., j] + w
        d = sign * xyz[..., k] - xyz[..., i]
    near, far = np.hypot(a, b), np.hypot(c, d)
    second = 2.0 * np.arctan2(far, near)
    half_sum, half_difference = np.arctan2(b, a), np.arctan2(d, c)
    is_flat, is_folded = far <= 1e-12, near <= 1e-12
    first = np.where(is_flat | is_folded, 0.0, half_sum - half_difference)
    locked = [2.0 * half_sum, 2.0 * half_difference]
    third = np.select([is_flat, is_folded], locked, half_sum + half_difference)
    if not is_proper:
        third = sign * third
        second = second - 0.5 * np.pi
    angles = np.stack([first, second, third], axis=-1)
    angles[..., ::2] -= 2.0 * np.pi * np.round(angles[..., ::2] / (2.0 * np.pi))
    return angles[..., ::-1] if is_intrinsic else angles


def to_scipy(q: ArrayLike) -> Rotation:
    """Return a :class:`scipy.spatial.transform.Rotation`, whose quaternions have *w* last.

    Raises:
        ValueError: a norm is not 1 within 1e-6.
        OrientdError: SciPy is not installed.
    """
    try:
        from scipy.spatial.transform import Rotation
    except ImportError as error:
        raise OrientdError(
            "a Rotation needs SciPy, which is not installed: pip install 'orientd-motion[scipy]'"
        ) from error

    return Rotation.from_quat(check_unit(q)[..., [1, 2, 3, 0]])


def from_scipy(rotation: Rotation) -> Floats:
    """Return the unit quaternions of a :class:`scipy.spatial.transform.Rotation`, *w* first."""
    quaternion: Floats = np.asarray(rotation.as_quat(), dtype=np.float64)[..., [3, 0, 1, 2]]
    return quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class Quaternion:
    """A unit quaternion with named components, tool to world, Hamilton's product.

    >>> Quaternion(w=1, x=0, y=0, z=0)
    Quaternion(w=1, x=0, y=0, z=0)
    """

    w: float
    x: float
    y: float
    z: float

    @classmethod
    def from_array(
        cls, array: ArrayLike, *, order: Literal["wxyz", "xyzw"]
    ) -> Quaternion | list[Quaternion]:
        """Return the quaternion of an array in the given order, or a list of quaternions.

        Args:
            array: shape ``(4,)`` or ``(n, 4)``.
            order: which column is which component.

        Raises:
            ValueError: *order* is neither of the two, or *array* has another shape.

        >>> Quaternion.from_array([0, 0, 0, 1], order="xyzw")
        Quaternion(w=1.0, x=0.0, y=0.0, z=0.0)
        """
        if order not in ("wxyz", "xyzw"):
            raise ValueError(f"order must be 'wxyz' or 'xyzw', got {order!r}")
        rows = np.asarray(array, dtype=np.float64)
        if rows.ndim not in (1, 2) or rows.shape[-1] != 4:
            raise ValueError(f"array must have shape (4,) or (n, 4), got {rows.shape}")
        if rows.ndim == 1:
            return cls(**dict(zip(order, rows.tolist(), strict=True)))
        return [cls(**dict(zip(order, row, strict=True))) for row in rows.tolist()]


def is_rotation(value: object) -> bool:
    """Return whether *value* is a ``Rotation`` of SciPy."""
    # A caller that has a Rotation has imported SciPy; no other caller needs it.
    transform = sys.modules.get("scipy.spatial.transform")
    return transform is not None and isinstance(value, transform.Rotation)


def unnamed(value: Any) -> Any:  # noqa: ANN401 - any parameter
    """Return orientations as quaternions ``(w, x, y, z)``, and any other value unchanged.

    One ``Rotation`` or :class:`Quaternion` becomes an array of shape ``(4,)``.  A ``Rotation`` of
    *n* rotations, or a list of *n* single ones, becomes an array of shape ``(n, 4)``.

    >>> unnamed([Quaternion(w=1, x=0, y=0, z=0)])
    array([[1., 0., 0., 0.]])
    """
    if isinstance(value, Quaternion):
        return np.array([value.w, value.x, value.y, value.z], dtype=np.float64)
    if is_rotation(value):
        return from_scipy(value)
    entries = value if isinstance(value, list | tuple) else ()
    if any(isinstance(entry, Quaternion) or is_rotation(entry) for entry in entries):
        return np.array([unnamed(entry) for entry in entries])
    return value
