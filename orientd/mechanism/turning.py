"""Joint motions of a gimbal from rest to rest: to home, and to an orientation by the joints.

The limits of the angles form a box, so the straight line between two sets of axis angles never
leaves it.  The pole needs no special treatment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints, Quaternion, Vector3
from orientd.errors import PlanError
from orientd.mechanism.arrays import orientations, pole_distances, row_of
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    refuse_angle,
)
from orientd.mechanism.mechanism import inside
from orientd.mechanism.way import Slew, Way
from orientd.rotation import Floats, conjugate, exp, log, multiply, rotate
from orientd.rotation import angle as distance

_TURN = 2 * math.pi
CLOSE, HOP = 3e-3, 8e-3
"""Sine of the distance from a pole within which the axes turn around it, and how far the tool goes
from it meanwhile, rad."""
_PLACES, _STEPS, _BESIDE = 513, 4, 1e-6
"""Places at which the length of a slew is measured, steps towards an orientation, and the distance
to the next place, as a share."""
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


def turned_to(gimbal: Gimbal, joints: Joints, q: Quaternion) -> Joints:
    """Return the axis angles for an orientation to which all axes turn least, rad.

    Args:
        gimbal: the gimbal.
        joints: initial axis angles, rad.
        q: final orientation.

    Raises:
        LimitError: no axis angles within the limits make *q*; the error names the axis.
        PlanError: two axes cannot make *q*.
    """
    if gimbal.solve(q, joints)[1] > gimbal.roll_tolerance:
        raise PlanError("two axes do not make this orientation")
    return min(windings(gimbal, q, joints), key=lambda one: _travel(joints, one))


def turned_together(gimbal: Gimbal, path: Way, near: Joints, goal: Joints = ()) -> Way:
    """Return the even turn of all axes from the start of a path to its end.

    Args:
        gimbal: kinematics and limits of the axes.
        path: the path.
        near: axis angles at its start, rad.
        goal: axis angles at its end, rad; by default those to which all axes turn least.

    Raises:
        LimitError: no axis angles within the limits make its end.
        PlanError: two axes do not make it.
    """
    first, last = path.trajectory.ends()[0]
    why = "not by the shortest turn: the axes cannot follow it, or would take longer"
    notes = () if goal else (why,)
    goal = goal or turned_to(gimbal, near, row_of(last))
    span = path.trajectory.domain
    # Rounding of the axis angles must not move the start.
    off = log(multiply(first, conjugate(orientations(gimbal, np.array(near)))))
    middle = orientations(gimbal, 0.5 * np.add(near, goal))
    ends = np.stack([first, middle, last])
    aside = 0.0
    if float(np.max(pole_distances(gimbal, ends))) < CLOSE:
        # At the pole itself an orientation does not tell how outer and inner axis share a turn.
        aside = HOP if near[1] + HOP <= gimbal.axes[1].high else -HOP
    slew = Slew(*span, near, goal, aside)

    def turning(times: Floats) -> Floats:
        left = (times[:, None] - span[1]) / (span[0] - span[1]) * off
        return np.asarray(multiply(exp(left), turned(gimbal, slew, times)), dtype=np.float64)

    notes = (*path.notes, f"all axes turn together to {angles_in_words(goal)} deg", *notes)
    return replace(
        path, trajectory=Trajectory.fit(turning, span), notes=notes, slews=(*path.slews, slew)
    )


def turned(gimbal: Gimbal, slew: Slew, times: Floats) -> Floats:
    """Return the orientations at path *times* of a slew, shape ``(n, 4)``."""
    return orientations(gimbal, slew.angles((times - slew.begin) / (slew.end - slew.begin)))


def turned_along(gimbal: Gimbal, slew: Slew, near: Joints, q: Floats) -> Floats:
    """Return the axis angles in a slew for orientations on its way, rad, shape ``(n, axes)``.

    The length of the way tells the share about, and Gauss-Newton steps exactly.

    Args:
        gimbal: kinematics of the axes.
        slew: the slew, which may lead to the same orientation several times.
        near: axis angles on its way before the first orientation, rad.
        q: orientations in order, close together, shape ``(n, 4)``.
    """
    every = np.linspace(0.0, 1.0, _PLACES)
    passed = orientations(gimbal, slew.angles(every))
    lengths = np.concatenate([[0.0], np.cumsum(distance(passed[:-1], passed[1:]))])
    gap = np.subtract(slew.there, slew.here)
    begun = float(np.subtract(near, slew.here) @ gap) / max(float(gap @ gap), _PARALLEL)
    first = orientations(gimbal, slew.angles(np.clip([begun], 0.0, 1.0)))
    gone = np.cumsum(distance(np.concatenate([first, q[:-1]]), q))
    shares = np.interp(np.interp(begun, every, lengths) + gone, lengths, every)
    for _ in range(_STEPS):
        made = orientations(gimbal, slew.angles(shares))
        beside = orientations(gimbal, slew.angles(shares + _BESIDE))
        rate = log(multiply(conjugate(made), beside)) / _BESIDE
        left = log(multiply(conjugate(made), q))
        square = np.maximum(np.sum(rate * rate, axis=1), _PARALLEL)
        shares = np.clip(shares + np.sum(left * rate, axis=1) / square, 0.0, 1.0)
    return slew.angles(shares)


def angles_in_words(joints: Joints) -> str:
    """Return axis angles in degrees, for a note."""
    return ", ".join(f"{math.degrees(one):.1f}" for one in joints)
