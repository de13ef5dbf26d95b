"""A motion on the path that a device's axes can follow, with the limits checked again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import StartError
from orientd.mechanism import JointPath
from orientd.planner import refusal
from orientd.planner.certify import (
    PARTS,
    STATE,
    before,
    joint_brake,
    measure,
    summed_up,
    tool_brake,
)
from orientd.planner.motion import Motion
from orientd.planner.path import SAME_ANGLE, Path, RecordedPath
from orientd.rotation import Floats, angle
from orientd.tolerances import GUARD_TOLERANCE

_SAME_TIME = 1e-9


def reshaped(
    motion: Motion,
    shape: JointPath,
    axes: Sequence[AxisLimits],
    *,
    joints_before: Sequence[Sequence[float]] = (),
    joint_rates: Sequence[float] = (),
) -> Motion:
    """Return *motion* on the path of *shape*, checked against its limits again.

    Args:
        motion: the motion as planned.
        shape: the path that the device's axes follow, on the same grid.
        axes: limits of the axes.
        joints_before: axis angles of the three records before a motion that begins in motion.
        joint_rates: axis velocities at the start of a motion that begins in motion, rad/s.

    Raises:
        LimitError: the shaped path breaks a limit.
        StartError: the shaped path begins elsewhere than a motion that begins in motion.
        ValueError: *motion* already has a shape.
    """
    if not isinstance(motion.path, Path):
        raise ValueError("motion already has a path of the axes")
    period, request = motion.period, motion.request
    path_times, q, joints = shape.path_times, shape.q, shape.joints
    begun = float(angle(q[0], motion.start_state.q))
    if begun > SAME_ANGLE and not motion.start_state.is_at_rest:
        raise StartError(
            f"the device's axes begin {begun:.3g} rad from where the motion takes over in motion"
        )
    earlier = np.asarray(joints_before, dtype=np.float64) if len(joints_before) else None
    start = motion.start_state
    if start.is_at_rest and begun > SAME_ANGLE:
        # The axes are unknown, so the plan has chosen the roll in which they begin.
        start = replace(start, q=q[0], before=None)
    path = RecordedPath.of(q, path_times, motion.path, period, joints, earlier, joint_rates)

    def moved(times: Floats) -> Floats:
        """Return when the shaped path reaches *times* of the planned path."""
        grid = period * np.arange(len(path_times), dtype=np.float64)
        if len(path_times) == motion.record_count and np.allclose(
            path_times, grid, rtol=0, atol=1e-9
        ):
            return times
        found = np.searchsorted(path_times, times - _SAME_TIME)
        return np.minimum(found, len(path_times) - 1) * period

    begin, end, *keyframes = moved(
        np.array([motion.start_time, motion.end_time, *motion.keyframe_times])
    )
    peaks = measure(
        np.ascontiguousarray(path.table[:, :STATE]),
        len(path_times),
        period,
        motion.limits,
        before=before(start, period),
        tolerance=GUARD_TOLERANCE,
    )
    brake = joint_brake(joints, path.joint_rates, path.earlier, period, axes)
    if path.is_reshaped:
        # The records do not have the full motion of a tool that the axes lead off its path.
        between = path.between_records(PARTS)
        brake = min(brake, tool_brake(between, period, motion.limits.numbers()[4:8]))
    if brake.rate < peaks.brake_rate:
        peaks = replace(peaks, brake_rate=brake.rate, brake_time=brake.record * period)
    times = np.array(keyframes)
    place = refusal.Place(request, float(begin), float(end), times)
    refusal.check_limits(peaks, place)
    refusal.check_stop(peaks, place, motion.limits)
    ends = float(begin), float(end)
    certificate = summed_up(request, path, ends, times, peaks, period)
    return replace(
        motion,
        path=path,
        start_time=float(begin),
        end_time=float(end),
        keyframe_times=times,
        record_count=len(path_times),
        certificate=replace(
            certificate,
            figures=(*certificate.figures, *shape.figures),
            losses=shape.losses,
            notes=(*motion.certificate.notes, *shape.notes),
        ),
        first_joints=tuple(joints[0].tolist()),
        last_joints=tuple(joints[-1].tolist()),
    )
