"""Gimbal kinematics over whole paths: the formulas of :mod:`.gimbal` on arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.mechanism.gimbal import Functions, Gimbal, Kinematics
from orientd.rotation import Floats, normalize

_OF_ARRAYS = Functions(np.sin, np.cos, np.arctan2, np.hypot)


def of_arrays(gimbal: Gimbal) -> Kinematics:
    """Return the kinematics of *gimbal* with one array per component."""
    return replace(gimbal.kinematics, functions=_OF_ARRAYS)


def orientations(gimbal: Gimbal, joints: ArrayLike) -> Floats:
    """Return orientations for axis angles: ``(..., axes)`` rad to ``(..., 4)``."""
    columns = np.moveaxis(np.asarray(joints, dtype=np.float64), -1, 0)
    return normalize(np.stack(of_arrays(gimbal).orientation(columns), axis=-1))


def matrices(gimbal: Gimbal, q: Floats) -> Floats:
    """Return the rotations that the axes alone must make, component by component.

    Args:
        gimbal: the gimbal.
        q: tool orientations, shape ``(n, 4)``.

    Returns:
        Components of rotation matrices, shape ``(9, n)``.
    """
    return np.stack(of_arrays(gimbal).matrix(q.T))


def joints_at(gimbal: Gimbal, matrix: Floats, outer: Floats) -> Floats:
    """Return the best axis angles for given outer angles, rad, shape ``(n, axes)``.

    Args:
        gimbal: the gimbal.
        matrix: as from :func:`matrices`.
        outer: outer angles in rad, shape ``(n,)``.
    """
    inner, _ = of_arrays(gimbal).inner(matrix, outer)
    return np.stack([outer, *inner], axis=-1)


def wrapped(angle: Floats) -> Floats:
    """Return an angle without whole turns, in (-pi, pi]."""
    less: Floats = np.asarray(angle - 2 * np.pi * np.ceil((angle - np.pi) / (2 * np.pi)))
    return less
