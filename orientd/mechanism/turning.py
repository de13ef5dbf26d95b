"""Joint motions of a gimbal from rest to rest: to home, and to an orientation by the joints.

The limits of the angles form a box, so the straight line between two sets of axis angles never
leaves it.  The pole needs no special treatment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    planned,
)
from orientd.mechanism.mechanism import inside
from orientd.mechanism.slews import straight
from orientd.rotation import Floats, conjugate, exp, rotate

_TURN = 2 * math.pi
_ALONG = 1e-9
"""Largest difference of a cosine from 1 at which an axis is along the pointing axis."""
_PARALLEL = 1e-12
"""Square of the sine of the angle below which two vectors are parallel."""


def pointed(
    gimbal: Gimbal, directions: Sequence[Vector3], axis: str, near: Joints
) -> list[Joints] | None:
    """Return axis angles within the limits that point an axis of the tool in directions.

    The roll axis of three axes stays as close to home as each direction allows.  It is the axis
    along the pointing axis of the tool at home; if none is, the innermost axis.  The other two axes
    stay on one branch, because the tool turns over between the branches: the one with less roll,
    then the one that turns its inner axis less.

    Args:
        gimbal: the gimbal.
        directions: in the world.
        axis: of the tool, ``x``, ``y`` or ``z``.
        near: current axis angles, rad, that decide about whole turns.

    Returns:
        ``None`` if no axis angles of one branch within the limits point there.
    """
    kinematics, home = gimbal.kinematics, gimbal.home()
    points = rotate(np.array(kinematics.tool), np.eye(3)["xyz".index(axis)])
    aims = rotate(conjugate(np.array(kinematics.mount)), np.array(directions))
    roll: int | None = None
    if len(gimbal.axes) == 3:
        along = np.abs(np.eye(3)[list(kinematics.axes)] @ points)
        is_along = np.flatnonzero(along > 1.0 - _ALONG)
        roll = int(is_along[-1]) if len(is_along) else 2
    inner = max(place for place in range(len(gimbal.axes)) if place != roll)
    chains: list[tuple[float, float, list[Joints]]] = []
    for branch in (0, 1):
        chain, last = [], near
        for aim in aims:
            found = _pointed(gimbal, points, aim, last, roll, branch)
            if found is None:
                break
            chain.append(last := found)
        else:
            rolled = 0.0 if roll is None else max(abs(one[roll] - home[roll]) for one in chain)
            chains.append((rolled, max(abs(one[inner] - home[inner]) for one in chain), chain))
    return min(chains)[2] if chains else None


def _pointed(
    gimbal: Gimbal, points: Floats, aim: Floats, near: Joints, roll: int | None, branch: int
) -> Joints | None:
    """Return axis angles on a branch that turn *points* to *aim*, with the least roll, rad.

    Args:
        gimbal: the gimbal.
        points: unit vector at home.
        aim: unit vector.
        near: axis angles that decide about whole turns, rad.
        roll: place of the roll axis; ``None`` for two axes.
        branch: of the other two axes, 0 or 1.
    """
    axes = np.eye(3)[list(gimbal.kinematics.axes)]
    if roll is None:
        pair = _pointing(axes[0], axes[1], points, aim, near, branch)
        return None if pair is None else inside(gimbal.axes, pair, near)
    home, (low, high) = gimbal.home()[roll], (gimbal.axes[roll].low, gimbal.axes[roll].high)
    steps = home + np.radians(np.arange(-180.0, 181.0))
    rolls = np.concatenate([steps[(steps > low) & (steps < high)], [low, high]])
    outer, inner = (place for place in range(3) if place != roll)
    for angle in sorted(rolls.tolist(), key=lambda one: abs(one - home)):
        # The roll turns the tool, and the axes inside of it.
        turn = exp(angle * axes[roll])
        one, two = (rotate(turn, axes[m]) if m > roll else axes[m] for m in (outer, inner))
        pair = _pointing(one, two, rotate(turn, points), aim, (near[outer], near[inner]), branch)
        if pair is not None:
            found = inside(gimbal.axes, (*pair[:roll], angle, *pair[roll:]), near)
            if found is not None:
                return found
    return None


def _pointing(
    outer: Floats, inner: Floats, points: Floats, aim: Floats, near: Joints, branch: int
) -> Joints | None:
    """Return the angles about two axes that turn one unit vector into another, rad.

    The inner turn takes *points* to a vector that the outer turn takes to *aim*.  Two vectors are
    at the right angles to both axes, one for each branch.

    Args:
        outer: the outer axis.
        inner: the inner axis.
        points: the vector to turn.
        aim: the vector to turn it to.
        near: angles to keep if any angle will do.
        branch: 0 or 1.
    """
    cosine, across = float(outer @ inner), np.cross(outer, inner)
    square = float(across @ across)
    if square < _PARALLEL:
        return None
    a = (float(outer @ aim) - cosine * float(inner @ points)) / square
    b = (float(inner @ points) - cosine * float(outer @ aim)) / square
    rest = (1.0 - a * a - b * b - 2.0 * a * b * cosine) / square
    if rest < -_PARALLEL:
        return None
    aside = math.copysign(math.sqrt(max(rest, 0.0)), 0.5 - branch)
    between = a * outer + b * inner + aside * across
    return _turned(outer, between, aim, near[0]), _turned(inner, points, between, near[1])


def _turned(axis: Floats, begin: Floats, end: Floats, near: float) -> float:
    """Return the turn about *axis* from one vector to another, rad; *near* if both are along it."""
    sine = float(axis @ np.cross(begin, end))
    cosine = float(begin @ end) - float(axis @ begin) * float(axis @ end)
    return math.atan2(sine, cosine) if math.hypot(sine, cosine) > _PARALLEL else near


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
    figures = (
        Figure("pointing error", 0.0, "rad", gimbal.max_deviation, 0.0),
        manipulability(gimbal, turned),
    )
    goal = ", ".join(f"{degrees(angle):.1f}" for angle in end)
    times = period * np.arange(len(turned), dtype=np.float64)
    notes = (f"all axes turn together to {goal} deg",)
    return JointPath(period, turned, orientations(gimbal, turned), times, figures, notes)
