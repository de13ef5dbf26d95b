"""Orientations that say what they are: SciPy's rotations and quaternions by name.

Four bare numbers do not say which of them is the scalar.  What is written by hand is a
``scipy.spatial.transform.Rotation``, a :class:`Quaternion`, or an array whose order was said.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation.convert import from_scipy


@dataclass(frozen=True, slots=True, kw_only=True)
class Quaternion:
    """A unit quaternion, tool to world, Hamilton's product, with its components by name.

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
        """Return the quaternions in an array whose order is said: one, or a list of them.

        Args:
            array: shape ``(4,)`` or ``(n, 4)``.
            order: which column is which component.

        Raises:
            ValueError: *order* is neither, or *array* has another shape.

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
    # Whoever has a Rotation has imported SciPy; nobody else needs it.
    transform = sys.modules.get("scipy.spatial.transform")
    return transform is not None and isinstance(value, transform.Rotation)


def unnamed(value: Any) -> Any:  # noqa: ANN401 - whatever a parameter may be
    """Return orientations as quaternions ``(w, x, y, z)``, anything else as it is.

    A ``Rotation`` of *n* rotations, and a list of *n* that are named or single ones, become an
    array of shape ``(n, 4)``, one becomes ``(4,)``.

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
