"""The axes of a mechanism along a path, at whatever pace: exactly on it, on their initial branch.

A path along which they cannot go is refused with its place.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from orientd.driver import AxisLimits, Joints, Quaternion, Vector3
from orientd.errors import PlanError, StartError
from orientd.mechanism.arrays import AT_POLE, joints_at, matrices, orientations, outer_line, row_of
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    refuse_angle,
    refuse_range,
)
from orientd.mechanism.mechanism import Mechanism, Rows, inside
from orientd.mechanism.pointing import figures_of
from orientd.rotation import Floats, check_unit

_LONGEST_STEP = 0.5
"""Distance in rad; neighbouring samples that are farther apart are on different branches."""
_TURN = 2.0 * np.pi
_RANGE_ADVICE = "turn less far (a turn by a shorter `--duration`), or unwind it first"


def at_time(time: float) -> str:
    """Return where a path is at a time, s, in words."""
    return f"at {time:.4f} s"


def joints_along(
    mechanism: Mechanism,
    times: Floats,
    q: Floats,
    position: Floats,
    near: Joints,
    place: Callable[[float], str] = at_time,
    last: Joints = (),
) -> Floats:
    """Return axis angles along a path, ignoring limits, rad, shape ``(n, axes)``.

    A gimbal stays on the branch and the turns on which it begins.

    Args:
        mechanism: kinematics of the axes.
        times: of the poses, s, shape ``(n,)``.
        q: tool orientations, shape ``(n, 4)``.
        position: tool positions, m, shape ``(n, 3)``.
        near: axis angles at the start, rad; empty if unknown.
        place: returns where a path is at a time, in words for a refusal.
        last: axis angles at the end, if that is at the pole of a gimbal and they are known, rad.

    Raises:
        PlanError: a pose is out of reach.
    """
    near = near or beginnings(mechanism, row_of(q[0]), tuple(position[0].tolist()))[0]
    if isinstance(mechanism, Gimbal):
        return _line(mechanism, check_unit(q), near, last)
    poses = Rows(len(q), 7, np.concatenate([q, position], axis=1).tobytes())
    found = Rows(len(q), len(mechanism.axes))
    reached = mechanism.follow(poses, near, found, len(q))
    if reached < len(q):
        raise PlanError(f"the axes do not reach the pose {place(float(times[reached]))}")
    return np.array(found.view)


def _line(gimbal: Gimbal, q: Floats, near: Joints, goal: Joints = ()) -> Floats:
    """Return the axis angles of a gimbal on the branch and the turns nearest to *near*, rad."""
    matrix, last = matrices(gimbal, q), np.array(near)
    one = row_of(q[0])
    ways = np.array(
        [gimbal.solve(one, near)[0]] if gimbal.is_fitting else gimbal.branches(one, near)
    )
    ways += _TURN * np.round((last - ways) / _TURN)
    begin = ways[int(np.argmin(np.abs(ways - last).max(axis=1)))]
    is_at_pole = gimbal.kinematics.pointing(gimbal.kinematics.matrix(one))[1] <= AT_POLE
    first = float(begin[0]) if is_at_pole else None
    outer, sine = outer_line(gimbal, matrix, first)
    outer += np.pi * np.round((begin[0] - outer[0]) / np.pi)
    at_pole = int(np.argmax(sine[::-1] > AT_POLE)) if goal else 0
    if at_pole:
        outer[-at_pole:] += np.linspace(0.0, goal[0] - outer[-1], at_pole + 1)[1:]
    joints = joints_at(gimbal, matrix, outer)
    joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
    joints[:, 1:] += _TURN * np.round((begin[1:] - joints[0, 1:]) / _TURN)
    return joints


def beginnings(mechanism: Mechanism, q: Quaternion, position: Vector3) -> list[Joints]:
    """Return the axis angles for a pose inside their ranges, those nearest to home first, rad.

    A gimbal has them on every turn of its axes.

    Raises:
        LimitError: a gimbal has no axis angles inside the ranges for the pose.
        StartError: another mechanism has none.
    """
    middle = mechanism.home() or (0.0,) * len(mechanism.axes)
    found = []
    for one in mechanism.solutions(q, position):
        near = inside(mechanism.axes, one, middle)
        if near is None:
            continue
        found.append(near)
        if isinstance(mechanism, Gimbal):
            angles = zip(near, mechanism.axes, strict=True)
            found += list(product(*(_turns(angle, axis) for angle, axis in angles)))
    if not found and isinstance(mechanism, Gimbal):
        refuse_angle(np.array(mechanism.solutions(q)), mechanism.axes, 0.0)
    if not found:
        raise StartError("the axes do not reach where the path begins")
    return sorted(set(found), key=lambda one: max(map(abs, np.subtract(one, middle).tolist())))


def _turns(angle: float, axis: AxisLimits) -> list[float]:
    """Return an angle on the turns next to it, as far as they are inside the range."""
    every = angle, angle - _TURN, angle + _TURN
    return [one for one in every if axis.low <= one <= axis.high]


def made(
    mechanism: Mechanism, joints: Floats, q: Floats, period: float, missed: float = 0.0
) -> tuple[Floats, tuple[Figure, ...]]:
    """Return the orientations that axes make on a path, and figures about the way they take.

    Two axes turn a tool with another roll than that of the path.

    Args:
        mechanism: kinematics and limits of the axes.
        joints: axis angles from :func:`joints_along`, rad, shape ``(n, axes)``.
        q: tool orientations of the path, shape ``(n, 4)``.
        period: between them, s.
        missed: largest angle by which the path deviates from the requested one, rad.

    Raises:
        LimitError: two axes leave too much roll.
    """
    if not isinstance(mechanism, Gimbal):
        return q, ()
    reached = orientations(mechanism, joints)
    figures = figures_of(mechanism, joints, reached, q, period, (missed, None))
    return reached, figures


def check_way(
    mechanism: Mechanism,
    joints: Floats,
    times: Floats,
    place: Callable[[float], str] = at_time,
    *,
    is_dense: bool = True,
) -> None:
    """Check that the axes can go along a path, at whatever pace.

    Args:
        mechanism: kinematics and limits of the axes.
        joints: axis angles along the path, rad, shape ``(n, axes)``.
        times: of the rows, s, shape ``(n,)``.
        place: as for :func:`joints_along`.
        is_dense: whether neighbouring rows are close, unless an axis jumps.

    Raises:
        LimitError: an axis leaves its range.
        PlanError: it jumps, or comes too near to a singularity.
    """
    axes = mechanism.axes
    low, high, edge = np.array([(axis.low, axis.high, axis.resolution) for axis in axes]).T
    outside = np.any((joints < low - edge) | (joints > high + edge), axis=1)
    if np.any(outside):
        at = int(np.argmax(outside))
        time, name = float(times[at]), place(float(times[at]))
        advice = _RANGE_ADVICE if name == at_time(time) else f"{name}; {_RANGE_ADVICE}"
        refuse_range(joints[at].tolist(), axes, time, advice)
    steps = np.abs(np.diff(joints, axis=0))
    if is_dense and len(steps) and np.max(steps) > _LONGEST_STEP:
        row, axis = np.unravel_index(int(np.argmax(steps > _LONGEST_STEP)), steps.shape)
        raise PlanError(f"{axes[axis].name} would have to jump {place(float(times[row + 1]))}")
    _refuse_singular(mechanism, joints, times, place)


def _refuse_singular(
    mechanism: Mechanism, joints: Floats, times: Floats, place: Callable[[float], str]
) -> None:
    """Raise :class:`.PlanError` if *joints* come too near to a singularity."""
    kinds = mechanism.reserve(tuple(joints[0].tolist())) if len(joints) else ()
    if not kinds:
        return
    found = Rows(len(joints), len(kinds))
    rows = Rows(len(joints), joints.shape[1], joints.tobytes())
    mechanism.reserves(rows, found, len(joints))
    for one, values in zip(kinds, np.array(found.view).T, strict=True):
        at = int(np.argmin(values))
        if values[at] < one.least:
            raise PlanError(
                f"the {one.name} comes within {values[at]:.4f} {one.unit} of its singularity "
                f"{place(float(times[at]))}, at least {one.least:g} are needed; {one.advice}"
            )
