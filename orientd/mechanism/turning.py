"""Joint motions of a gimbal from rest to rest: to home, and to an orientation by the joints.

The limits of the angles form a box, so the straight line between two sets of axis angles never
leaves it.  The pole needs no special treatment.
"""

from __future__ import annotations

import math
from math import degrees

import numpy as np

from orientd.driver import Joints, Quaternion, Vector3
from orientd.mechanism.arrays import orientations
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.gimbal_route import manipulability, refuse_angle
from orientd.mechanism.joint_path import (
    Bounds,
    JointPath,
    ToolLimits,
    axis_peaks,
    certified,
    planned,
)
from orientd.mechanism.mechanism import inside
from orientd.mechanism.slews import straight
from orientd.rotation import conjugate, rotate

_TURN = 2 * math.pi


def pointed(gimbal: Gimbal, direction: Vector3, axis: str) -> Quaternion | None:
    """Return the orientation that points in a direction, with the innermost of three axes at zero.

    Args:
        gimbal: the gimbal.
        direction: in the world.
        axis: of the tool, ``x``, ``y`` or ``z``.

    Returns:
        ``None`` for two axes, or if the innermost axis is not the pointing one.
    """
    k = gimbal.kinematics
    points = rotate(np.array(k.tool), np.eye(3)["xyz".index(axis)])
    if len(gimbal.axes) == 2 or points[k.inner_axis] < 1.0 - 1e-9:
        return None
    matrix = np.zeros((3, 3))
    matrix[:, k.inner_axis] = rotate(conjugate(np.array(k.mount)), direction)
    nine = matrix.ravel().tolist()
    outer, _ = k.pointing(nine)
    return gimbal.orientation((outer, k.inner(nine, outer)[0][0], 0.0))


def windings(gimbal: Gimbal, q: Quaternion, last: Joints) -> list[Joints]:
    """Return the axis angles for *q* within the limits, the nearest ones of each branch, rad.

    At the pole three axes make *q* with any outer angle.  The inner one then stays where it is, or
    turns as far as the limits of the outer one require.

    Args:
        gimbal: the gimbal.
        q: tool orientation.
        last: current axis angles, rad.

    Raises:
        LimitError: no axis angles within the limits make *q*; the error names the axis.
    """
    branches = [gimbal.solve(q, last)[0]] if gimbal.is_fitting else gimbal.branches(q, last)
    found = []
    for branch in branches:
        nearest = inside(gimbal.axes, branch, last)
        if nearest is None and len(branch) == 3 and gimbal.is_at_pole(q):
            nearest = _shared(gimbal, q, last, branch)
        if nearest is not None:
            found.append(nearest)
    if not found:
        refuse_angle(np.array(branches), gimbal.axes, 0.0)
    return found


def _shared(gimbal: Gimbal, q: Quaternion, last: Joints, branch: Joints) -> Joints | None:
    """Return axis angles at the pole that share the turn between outer and inner axis."""
    outer, middle, inner = branch
    first, matrix = gimbal.axes[0], gimbal.kinematics.matrix(q)
    # Along a line of both angles the orientation is constant; one step shows its slope.
    slope = gimbal.kinematics.outer_at_pole(matrix, inner + 0.5) - outer
    slope = math.copysign(1.0, math.remainder(slope, _TURN))
    found = []
    for turns in range(-1, 2):
        near = outer + _TURN * (turns + round((last[0] - outer) / _TURN))
        for wanted in (first.low, first.high, min(max(near, first.low), first.high)):
            angles = inside(gimbal.axes, (wanted, middle, inner + slope * (wanted - near)), last)
            if angles is not None:
                found.append(angles)
    return min(found, key=lambda one: _travel(last, one), default=None)


def _travel(begin: Joints, end: Joints) -> float:
    return sum(abs(a - b) for a, b in zip(begin, end, strict=True))


def together(
    gimbal: Gimbal,
    joints: Joints,
    q: Quaternion | None,
    *,
    period: float,
    tool: ToolLimits,
    least: float = 0.0,
) -> JointPath | None:
    """Return the fastest joint motion of all axes from rest to rest within the limits.

    Args:
        gimbal: the gimbal.
        joints: initial axis angles, rad.
        q: final orientation; ``None`` is home.
        period: of the cycles, s.
        tool: limits of the tool.
        least: least duration, s.

    Returns:
        ``None`` if two axes cannot make *q*.

    Raises:
        LimitError: no axis angles within the limits make *q*; the error names the axis.
        PlanError: no duration keeps the limits of the tool.
    """
    if q is None:
        end = gimbal.home()
    elif gimbal.solve(q, joints)[1] > gimbal.roll_tolerance:
        return None
    else:
        end = min(windings(gimbal, q, joints), key=lambda one: _travel(joints, one))
    begin = np.array(joints)
    bounds = Bounds(period, planned(gimbal.axes, period), tool)
    turned = straight(gimbal, begin, np.array(end), bounds, least=least)
    peaks = list(axis_peaks(turned, period, gimbal.axes, turned[[0, 0, 0]]))
    figures = [
        Figure("pointing error", 0.0, "rad", gimbal.max_deviation, 0.0),
        manipulability(gimbal, turned),
    ]
    goal = ", ".join(f"{degrees(angle):.1f}" for angle in end)
    times = period * np.arange(len(turned), dtype=np.float64)
    path = JointPath(period, turned, orientations(gimbal, turned), times)
    return certified(path, peaks, figures, [f"all axes turn together to {goal} deg"])
