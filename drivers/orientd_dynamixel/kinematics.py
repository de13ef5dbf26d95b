r"""Gimbal kinematics: axis angles to orientation and back, both branches, manipulability.

A gimbal turns about two or three of the coordinate axes, named from the base to the tool by
capital letters: ``ZYX`` is yaw, pitch, roll.  With rotation matrices
:math:`R = R_i(a) R_j(b) R_k(c)`.  A two-axis gimbal points the axis that it cannot turn about.

Everything follows from one observation.  Let :math:`d = R e_t` be the direction of the innermost
axis, or of the pointing axis where there are two.  Once the outer angle *a* is chosen, the best
*b* and *c* leave the error :math:`\arcsin |e_j \cdot R_i(-a) d|`, exactly, because what is missing
is the middle angle of :math:`R_i(-a) R` taken apart in the order *j*, missing, *t*.  So the outer
angle alone decides, and its exact values lie half a turn apart: those are the two branches.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import (
    Floats,
    check_unit,
    conjugate,
    multiply,
    normalize,
    to_matrix,
)

IDENTITY = (1.0, 0.0, 0.0, 0.0)
LOCK = 1e-6
"""Sine of the distance from the pole below which outer and inner angle turn about one line."""


class InnerAxes(NamedTuple):
    """What the inner axes make of an orientation once the outer angle is chosen.

    Attributes:
        inner: angles of the inner axes, rad, shape ``(..., axes - 1)``.
        error: angle that remains, rad, shape ``(...)``.
    """

    inner: Floats
    error: Floats


def _split(matrix: Floats, i: int, j: int, k: int) -> tuple[Floats, Floats, Floats]:
    """Return the angles of ``R_i(a) R_j(b) R_k(c)`` with three different axes and |b| <= 90 deg."""
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    a = np.arctan2(-sign * matrix[..., j, k], matrix[..., k, k])
    b = np.arctan2(sign * matrix[..., i, k], np.hypot(matrix[..., j, k], matrix[..., k, k]))
    c = np.arctan2(-sign * matrix[..., i, j], matrix[..., i, i])
    return a, b, c


def _turned_back(matrix: Floats, i: int, angle: Floats) -> Floats:
    """Return ``R_i(-angle) matrix``; of columns, those."""
    u, v = (i + 1) % 3, (i + 2) % 3
    cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
    turned = np.array(np.broadcast_to(matrix, (*cos.shape[:-1], *matrix.shape[-2:])))
    row_u, row_v = matrix[..., u, :], matrix[..., v, :]
    turned[..., u, :] = cos * row_u + sin * row_v
    turned[..., v, :] = cos * row_v - sin * row_u
    return turned


def _turned_about(q: Floats, axis: int, angle: Floats) -> Floats:
    """Return *q* times the turn by *angle* about a coordinate axis."""
    i, j, k = axis + 1, (axis + 1) % 3 + 1, (axis + 2) % 3 + 1
    cos, sin = np.cos(angle / 2.0), np.sin(angle / 2.0)
    turned = np.empty((*angle.shape, 4))
    turned[..., 0] = cos * q[..., 0] - sin * q[..., i]
    turned[..., i] = cos * q[..., i] + sin * q[..., 0]
    turned[..., j] = cos * q[..., j] + sin * q[..., k]
    turned[..., k] = cos * q[..., k] - sin * q[..., j]
    return turned


@dataclass(frozen=True)
class Gimbal:
    """A gimbal of two or three axes.

    Attributes:
        order: the axes from base to tool, for example ``ZYX``, ``ZXY`` or ``ZY``.
        mount: orientation ``(w, x, y, z)`` of the base in the world.
        tool: orientation of the tool on the innermost axis.

    Raises:
        ValueError: *order* is not one there is.
    """

    order: str = "ZYX"
    mount: tuple[float, float, float, float] = IDENTITY
    tool: tuple[float, float, float, float] = IDENTITY

    def __post_init__(self) -> None:
        letters = self.order
        if len(letters) not in {2, 3} or any(letter not in "XYZ" for letter in letters):
            raise ValueError(f"order must be two or three of X, Y and Z, got {letters!r}")
        if any(a == b for a, b in pairwise(letters)):
            raise ValueError(f"order must not name an axis twice in a row, got {letters!r}")
        check_unit(self.mount)
        check_unit(self.tool)

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes as numbers, 0 is X."""
        return tuple("XYZ".index(letter) for letter in self.order)

    @property
    def inner_axis(self) -> int:
        """The innermost axis of three, or the axis that two point."""
        axes = self.axes
        return axes[2] if len(axes) == 3 else 3 - axes[0] - axes[1]

    def forward(self, angles: ArrayLike) -> Floats:
        """Return the tool's orientation ``(w, x, y, z)`` in the world.

        Args:
            angles: axis angles in rad, shape ``(..., axes)``.
        """
        angles = self._angles(angles)
        q: Floats = np.broadcast_to(np.array(self.mount), (*angles.shape[:-1], 4))
        for number, axis in enumerate(self.axes):
            q = _turned_about(q, axis, angles[..., number])
        return normalize(multiply(q, self.tool))

    def matrix(self, q: ArrayLike) -> Floats:
        """Return what the axes alone have to make of *q*, as a matrix, shape ``(..., 3, 3)``."""
        return to_matrix(multiply(multiply(conjugate(self.mount), q), conjugate(self.tool)))

    def pointing(self, matrix: Floats) -> tuple[Floats, Floats]:
        """Return an exact outer angle, and the sine of the distance from the pole.

        Args:
            matrix: as from :meth:`matrix`.

        Returns:
            The angle in rad, arbitrary at the pole, and the sine, both of shape ``(...)``.  Every
            half turn more is exact as well.
        """
        i, j = self.axes[:2]
        d = matrix[..., :, self.inner_axis]
        u, v = d[..., (i + 1) % 3], d[..., (i + 2) % 3]
        outer = np.arctan2(v, u) if j == (i + 2) % 3 else np.arctan2(-u, v)
        return outer, np.hypot(u, v)

    def rest(self, matrix: Floats, outer: ArrayLike) -> InnerAxes:
        """Return the inner angles that are best for a chosen outer one, and the error left.

        Args:
            matrix: as from :meth:`matrix`.
            outer: outer angle in rad, shape ``(...)``.
        """
        i, j = self.axes[:2]
        t = self.inner_axis
        outer = np.asarray(outer, dtype=np.float64)
        if len(self.axes) == 3:
            b, missing, c = _split(_turned_back(matrix, i, outer), j, 3 - j - t, t)
            return InnerAxes(np.stack([b, c], axis=-1), np.abs(missing))
        d = _turned_back(matrix[..., :, t : t + 1], i, outer)[..., 0]
        u, v = d[..., (j + 1) % 3], d[..., (j + 2) % 3]
        b = np.arctan2(v, u) if t == (j + 1) % 3 else np.arctan2(-u, v)
        error = np.arctan2(np.abs(d[..., j]), np.hypot(u, v))
        return InnerAxes(b[..., None], error)

    def inverse(self, q: ArrayLike, inner: ArrayLike | None = None) -> Floats:
        """Return the axis angles of both branches.

        A two-axis gimbal reproduces the direction of its pointing axis only; see
        :meth:`.AxisTracker.solve` for whole orientations.
        Within 1e-6 of the pole outer and inner angle turn about one line: *inner* is then kept.

        Args:
            q: orientations ``(w, x, y, z)``, shape ``(..., 4)``.
            inner: the innermost angle to keep at the pole, rad, shape ``(...)``; of two axes the
                outer one.  Default 0.

        Returns:
            Angles in (-pi, pi], shape ``(..., 2, axes)``.

        Raises:
            ValueError: *q* is not of unit norm.
        """
        matrix = self.matrix(check_unit(q))
        outer, sine = self.pointing(matrix)
        kept = np.broadcast_to(np.asarray(0.0 if inner is None else inner), outer.shape)
        outer = np.where(sine < LOCK, self._outer_at_pole(matrix, kept), outer)
        branches = []
        for turn in (0.0, np.pi):
            chosen = wrapped(outer + turn)
            branches.append(
                np.concatenate([chosen[..., None], self.rest(matrix, chosen).inner], axis=-1)
            )
        return np.stack(branches, axis=-2)

    def manipulability(self, angles: ArrayLike) -> Floats:
        r"""Return the least singular value of what the axis rates do; 0 is the pole.

        Of three axes that is of the Jacobian; of two, of the part that moves the pointing axis.
        Neighbouring axes are at right angles, so only the cosine *c* between the outermost and the
        innermost, or pointing, one matters: the squares of the singular values of the Jacobian are
        :math:`1 \pm c` and 1, those of the part are 1 and :math:`1 - c^2`.

        Args:
            angles: axis angles in rad, shape ``(..., axes)``.
        """
        middle = self._angles(angles)[..., 1]
        is_same = self.inner_axis == self.axes[0]
        sine = np.abs(np.sin(middle) if is_same else np.cos(middle))
        if len(self.axes) == 2:
            return np.asarray(sine, dtype=np.float64)
        cosine = np.abs(np.cos(middle) if is_same else np.sin(middle))
        return np.asarray(sine / np.sqrt(1.0 + cosine), dtype=np.float64)

    def turn_at_pole(self, matrix: Floats) -> Floats:
        """Return by how much the outer axis turns while the inner ones stand still at the pole.

        Args:
            matrix: as from :meth:`matrix`, all at the pole, shape ``(n, 3, 3)``.

        Returns:
            Angles from the first on, rad, unwrapped, shape ``(n,)``.
        """
        turn = np.unwrap(self._outer_at_pole(matrix, np.zeros(len(matrix))))
        return np.asarray(turn - turn[0], dtype=np.float64)

    def _outer_at_pole(self, matrix: Floats, kept: Floats) -> Floats:
        if len(self.axes) == 2:
            return kept
        i, j = self.axes[:2]
        t = self.inner_axis
        # R R_k(-c) = R_i(a) R_j(b): where b leaves e_j alone, its image shows a.
        transposed = np.swapaxes(matrix, -1, -2)
        image = _turned_back(transposed, t, -kept)[..., j, :]
        u, v = image[..., (i + 1) % 3], image[..., (i + 2) % 3]
        return np.arctan2(v, u) if j == (i + 1) % 3 else np.arctan2(-u, v)

    def _angles(self, angles: ArrayLike) -> Floats:
        array = np.asarray(angles, dtype=np.float64)
        if array.ndim == 0 or array.shape[-1] != len(self.axes):
            raise ValueError(
                f"angles must have {len(self.axes)} in their last axis, got shape {array.shape}"
            )
        return array


def wrapped(angle: Floats) -> Floats:
    """Return an angle less whole turns, in (-pi, pi]."""
    less: Floats = np.asarray(angle - 2 * np.pi * np.ceil((angle - np.pi) / (2 * np.pi)))
    return less
