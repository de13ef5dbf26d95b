"""The shape of a gimbal as lines: nested rings with pins, for pictures."""

from __future__ import annotations

from math import pi

import numpy as np

from orientd.driver import Vector3
from orientd.rotation import from_axis_angle, multiply, to_matrix
from orientd_dynamixel.kinematics import Gimbal

_OUTERMOST, _GAP = 0.15, 0.03
"""Radius of the pins' outer ends, and from ring to ring, m; real gimbals have any shape."""

_CORNERS = 24


def outline(gimbal: Gimbal, joints: tuple[float, ...]) -> list[list[Vector3]]:
    """Return two pins and a ring for each axis, from the base inwards.

    Each ring carries the pins of the next axis, and lies in the plane of its own and the next one;
    the innermost in that of its own and the tool's pointing axis.

    Args:
        gimbal: order of the axes, mount and tool.
        joints: axis angles, rad.

    Returns:
        Lines about the origin, m; empty where *joints* are not those of the gimbal.
    """
    axes = gimbal.axes
    if len(joints) != len(axes):
        return []
    unit = np.eye(3)
    around = np.linspace(0.0, 2.0 * pi, _CORNERS + 1)[:, None]
    q = np.array(gimbal.mount)
    lines = []
    for number, axis in enumerate(axes):
        q = multiply(q, from_axis_angle(unit[axis], joints[number]))
        inner = axes[number + 1] if number + 1 < len(axes) else (axis + 1) % 3
        outside = _OUTERMOST - number * _GAP
        own, next_one = to_matrix(q)[:, axis], to_matrix(q)[:, inner]
        lines += [np.array([s * outside * own, s * (outside - _GAP) * own]) for s in (1.0, -1.0)]
        lines.append((outside - _GAP) * (np.cos(around) * own + np.sin(around) * next_one))
    return [[(x, y, z) for x, y, z in line.tolist()] for line in lines]
