"""Gimbal kinematics over whole paths: the formulas of :mod:`.gimbal` on arrays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.driver import Quaternion
from orientd.mechanism.gimbal import Functions, Gimbal, Kinematics
from orientd.rotation import Floats, normalize

_OF_ARRAYS = Functions(np.sin, np.cos, np.arctan2, np.hypot)
AT_POLE = 2e-5
"""Sine of the distance from the pole below which the outer angle of a path is unknown: closer to it
an error of 1e-10 rad turns the outer axis."""

_THROUGH = 2
"""Number of samples at the pole that still count as a path straight through it."""


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


def pole_distances(gimbal: Gimbal, q: Floats) -> Floats:
    """Return the sine of the distance from the pole, shape ``(n,)``, for *q*, ``(n, 4)``."""
    _, sine = of_arrays(gimbal).pointing(matrices(gimbal, q))
    return np.asarray(sine, dtype=np.float64)


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


def outer_line(gimbal: Gimbal, matrix: Floats, first: float | None = None) -> tuple[Floats, Floats]:
    """Return one continuous line of exact outer angles, and the distance from the pole.

    Exact angles lie half a turn apart, so the line is straight if the path goes through the pole.
    While the path stays at the pole any angle is exact, and the outer axis alone turns the tool.
    The line may then jump if the path leaves in another direction.

    Args:
        gimbal: the gimbal.
        matrix: as from :func:`.matrices`, shape ``(9, n)``.
        first: outer angle at the start of a path that begins at the pole, rad; by default the one
            with which it leaves the pole.

    Returns:
        Angles in rad and the sine of the distance from the pole, both of shape ``(n,)``.
    """
    outer, sine = of_arrays(gimbal).pointing(matrix)
    is_known = sine > AT_POLE
    known = np.nonzero(is_known)[0]
    if known.size:
        line = np.interp(np.arange(len(outer)), known, np.unwrap(outer[known], period=np.pi))
    else:
        line = np.zeros_like(outer)
    edges = np.nonzero(np.diff(np.concatenate([[True], is_known, [True]])))[0]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if begin > 0 and end - begin <= _THROUGH:
            continue
        turn = _turn_at_pole(gimbal, matrix[:, begin:end])
        if begin:
            line[begin:end] = line[begin - 1] + turn
        elif first is not None:
            line[:end] = first + turn
        elif end < len(line):
            line[:end] = line[end] + turn - turn[-1]
        else:
            line += turn
        if 0 < end < len(line):
            line[end:] += np.pi * np.round((line[end - 1] - line[end]) / np.pi)
    return line, sine


def _turn_at_pole(gimbal: Gimbal, matrix: Floats) -> Floats:
    """Return the turn of the outer axis while the inner ones stand still, from 0 on, rad."""
    count = matrix.shape[1]
    if len(gimbal.axes) == 2:
        return np.zeros(count)
    turn = np.unwrap(of_arrays(gimbal).outer_at_pole(matrix, np.zeros(count)))
    return np.asarray(turn - turn[0], dtype=np.float64)


def row_of(q: Floats) -> Quaternion:
    """Return an orientation, shape ``(4,)``, as plain floats."""
    w, x, y, z = q.tolist()
    return w, x, y, z
