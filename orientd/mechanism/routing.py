"""Joint paths for a tool path, planned before the motion starts.

The whole path is known in advance.  A gimbal chooses branches and turns by least cost over all of
it.  It passes the pole with the least deviation that the axes need, and stops to slew if that is
allowed.  Any other mechanism follows the path exactly, on its initial branch.  An infeasible path
is refused with axis, value and time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from orientd.driver import Joints, Quaternion, Vector3
from orientd.errors import PlanError, StartError
from orientd.mechanism.arrays import joints_at, matrices, outer_line
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.gimbal_route import certify, plan_axes, row_of
from orientd.mechanism.joint_path import (
    Bounds,
    JointPath,
    ToolLimits,
    planned,
    refuse_range,
)
from orientd.mechanism.keep_out_slews import Clearance
from orientd.mechanism.mechanism import Mechanism, Rows, inside
from orientd.mechanism.timed_route import TimedPath, timed_route
from orientd.rotation import Floats, check_unit

_LONGEST_STEP = 0.5
"""Distance in rad; neighbouring samples that are farther apart are on different branches."""
_STILL = 1e-9
_RANGE_ADVICE = "turn less far (a turn by a shorter `--duration`), or unwind it first"


def _at(time: float) -> str:
    return f"at {time:.4f} s"


def route(
    gimbal: Gimbal,
    period: float,
    q: Floats,
    *,
    joints: Joints = (),
    before: Sequence[Joints] = (),
    tool: ToolLimits | None = None,
    free: float = 0.0,
) -> JointPath:
    """Return the joint path of a gimbal for a tool path.

    Args:
        gimbal: kinematics and limits of the axes.
        period: of the grid, s.
        q: tool orientations up to rest, shape ``(n, 4)``.
        joints: planned or reported axis angles at the start, rad; empty if unknown.
        before: planned axis angles of the periods before a path that begins in motion, oldest
            first; empty for a path that begins at rest.
        tool: limits of the tool where the axes leave the path or its times; none by default.
        free: path time up to which the path may stand while the gimbal turns at its pole, s.

    Raises:
        LimitError: an axis cannot follow, or a gimbal of two axes leaves too much roll.
        PlanError: the axes can neither follow the path nor rejoin it.
        StartError: the axes cannot be at the start of the path.
        ValueError: a quaternion is not of unit norm.
    """
    q, past = check_unit(q), np.reshape(np.array(before), (-1, len(gimbal.axes)))
    start = np.array(gimbal.solve(row_of(q[0]), joints)[0]) if joints else None
    found = plan_axes(gimbal, q, period, start=start, past=past, tool=tool, free=free)
    return certify(gimbal, found, q)


def route_at_times(
    gimbal: Gimbal,
    period: float,
    q: Floats,
    ends: tuple[float, float],
    *,
    joints: Joints = (),
    before: Sequence[Joints] = (),
    tool: ToolLimits | None = None,
    keep_out: tuple[Clearance, ...] = (),
) -> JointPath:
    """Return the joint path of a gimbal for a tool path that keeps its times.

    At rest, the lead-in of the axes takes the place of the one of *q*, and may last longer.

    Args:
        gimbal: kinematics and limits of the axes.
        period: of the grid, s.
        q: tool orientations up to rest, shape ``(n, 4)``.
        ends: path times of the first keyframe and of the last, s.
        joints: planned or reported axis angles at the start, rad; empty if unknown.
        before: as for :func:`route`.
        tool: limits of the tool; none by default.
        keep_out: clearances from keep-out cones that slews of two axes keep if they can; if one
            cannot be kept, the next one counts.

    Raises:
        LimitError: an axis cannot follow.
        PlanError: the axes can neither follow the path nor rejoin it.
        StartError: the axes cannot be at the start of the path.
        ValueError: a quaternion is not of unit norm.
    """
    q, past = check_unit(q), np.reshape(np.array(before), (-1, len(gimbal.axes)))
    begin, end = (round(time / period) for time in ends)
    is_moving = len(past) > 0 and bool(np.ptp(past, axis=0).max() > _STILL)
    first = begin if begin and not is_moving else 0
    start = np.array(gimbal.solve(row_of(q[0]), joints)[0]) if joints else None
    at = np.arange(first, len(q))
    path = TimedPath(
        q[first:],
        (at >= begin) & (at <= end),
        start,
        past if is_moving else past[:0],
        first > 0,
        keep_out,
    )
    bounds = Bounds(period, planned(gimbal.axes, period), tool or ToolLimits())
    found, lead = timed_route(gimbal, path, bounds)
    times = found.path_times + first * period
    if lead:
        times[:lead] = np.linspace(0.0, first * period, lead, endpoint=False)
    return replace(found, path_times=times)


def joints_along(
    mechanism: Mechanism,
    times: Floats,
    q: Floats,
    position: Floats,
    near: Joints,
    place: Callable[[float], str] = _at,
) -> Floats:
    """Return axis angles along a path, ignoring limits, rad, shape ``(n, axes)``.

    Args:
        mechanism: kinematics of the axes.
        times: of the poses, s, shape ``(n,)``.
        q: tool orientations, shape ``(n, 4)``.
        position: tool positions, m, shape ``(n, 3)``.
        near: axis angles at the start, rad; empty if unknown.
        place: returns where a path is at a time, in words for a refusal.

    Raises:
        PlanError: a pose is out of reach.
    """
    if isinstance(mechanism, Gimbal):
        matrix = matrices(mechanism, check_unit(q))
        joints = joints_at(mechanism, matrix, outer_line(mechanism, matrix)[0])
        joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
        return joints
    near = near or begun(mechanism, row_of(q[0]), tuple(position[0].tolist()))
    poses = Rows(len(q), 7, np.concatenate([q, position], axis=1).tobytes())
    found = Rows(len(q), len(mechanism.axes))
    reached = mechanism.follow(poses, near, found, len(q))
    if reached < len(q):
        raise PlanError(f"the axes do not reach the pose {place(float(times[reached]))}")
    return np.array(found.view)


def begun(mechanism: Mechanism, q: Quaternion, position: Vector3) -> Joints:
    """Return axis angles for a pose inside their ranges, the nearest to home, rad.

    Raises:
        StartError: no axis angles inside the ranges pose the tool so.
    """
    middle = mechanism.home() or (0.0,) * len(mechanism.axes)
    every = (inside(mechanism.axes, one, middle) for one in mechanism.solutions(q, position))
    found = [one for one in every if one is not None]
    if not found:
        raise StartError("the axes do not reach where the path begins")
    return min(found, key=lambda one: max(abs(a - b) for a, b in zip(one, middle, strict=True)))


def check_way(
    mechanism: Mechanism,
    joints: Floats,
    times: Floats,
    place: Callable[[float], str] = _at,
    *,
    is_dense: bool = True,
) -> None:
    """Check that the axes can go along a path, at whatever pace.

    Args:
        mechanism: any but a gimbal, whose axes may also go along it on other turns.
        joints: axis angles along the path, rad, shape ``(n, axes)``.
        times: of the rows, s, shape ``(n,)``.
        place: as for :func:`joints_along`.
        is_dense: whether neighbouring rows are close, unless an axis jumps.

    Raises:
        LimitError: an axis leaves its range.
        PlanError: it jumps, or comes too near to a singularity.
    """
    axes = mechanism.axes
    low, high = np.array([(axis.low, axis.high) for axis in axes]).T
    outside = np.any((joints < low) | (joints > high), axis=1)
    if np.any(outside):
        at = int(np.argmax(outside))
        time, name = float(times[at]), place(float(times[at]))
        advice = _RANGE_ADVICE if name == _at(time) else f"{name}; {_RANGE_ADVICE}"
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
