"""From a path to a motion: its records are checked against the limits, and certified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import StartError
from orientd.mechanism import Gimbal
from orientd.mechanism.joint_path import JointPath, losses_of
from orientd.mechanism.pointing import pointing_error
from orientd.mechanism.poles import through_poles
from orientd.mechanism.way import Slew, Way
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner import refusal
from orientd.planner.certify.certificate import Certificate
from orientd.planner.certify.measuring import STATE, AxisRecords, measure
from orientd.planner.certify.summary import before, summed_up, summed_up_axes
from orientd.planner.motion import Motion
from orientd.planner.path import SAME_ANGLE, Path, RecordedPath
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle
from orientd.tolerances import GUARD_TOLERANCE

_END_SLACK = 1e-9  # of a period
_SAME_TIME = 1e-9  # s


def certified(
    whole: KeyframePath,
    request: MotionRequest,
    start: State,
    limits: Limits,
    period: float,
    *,
    motion_id: str,
    axes: Axes | None = None,
) -> Motion:
    """Return the motion along a path, checked against its limits on the records to be sent.

    Args:
        whole: from rest to rest, or from the state of the motion that it takes over.
        axes: of the device, whose limits are checked too if the records have them.

    Raises:
        LimitError: it breaks one.
        PlanError: the axes cannot go along it.
    """
    path: Path | RecordedPath = Path.joined([whole.trajectory], whole.positions, start.q)
    count = math.ceil(path.duration / period - _END_SLACK) + 1
    begin, end = whole.times[[0, -1]].tolist()
    records = None
    if axes is not None and axes.is_recorded and isinstance(path, Path):
        path, records = axes.recorded(path, count, period, whole.missed, whole.slews)
    certificate = certificate_of(path, count, whole.times, request, start, limits, period, records)
    if axes is not None and whole.slews:
        certificate = _with_slews(certificate, path, whole.slews, axes)
    return Motion(
        id=motion_id,
        request=request,
        limits=limits,
        period=period,
        path=path,
        start_time=begin,
        end_time=end,
        keyframe_times=whole.times,
        record_count=count,
        certificate=certificate,
        first_joints=() if records is None else records.first,
        last_joints=() if records is None else records.last,
        before=start.before,
    )


def _with_slews(
    certificate: Certificate, path: Path | RecordedPath, slews: Sequence[Slew], axes: Axes
) -> Certificate:
    """Return a certificate that says when the axes of a gimbal leave the path for slews."""
    if not (isinstance(path, RecordedPath) and isinstance(axes.mechanism, Gimbal)):
        return certificate
    losses, notes, period = list(certificate.losses), [], path.period
    for slew in slews:
        if slew.q is None:
            continue
        first, last = math.ceil(slew.begin / period), math.floor(slew.end / period)
        q = path.table[first : last + 1, :4]
        error = pointing_error(axes.mechanism, q, np.repeat(slew.q[None], len(q), axis=0))
        losses += [
            one._replace(start=one.start + first * period, end=one.end + first * period)
            for one in losses_of(error, period, axes.mechanism.on_target)
        ]
        goal = ", ".join(f"{math.degrees(angle):.1f}" for angle in slew.there)
        off = math.degrees(float(np.max(error, initial=0.0)))
        notes.append(
            f"{slew.begin:.3f} to {slew.end:.3f} s ({slew.end - slew.begin:.2f} s): the path stops "
            f"and the axes slew to {goal} deg, off it by up to {off:.1f} deg"
        )
    return replace(certificate, losses=tuple(losses), notes=(*certificate.notes, *notes))


def with_axes(motion: Motion, axes: Axes, deviation: float = 0.0) -> Motion:
    """Return the motion of a tool with the axes of a device on its path.

    Args:
        motion: of the tool.
        axes: of the device.
        deviation: largest angle by which the path may be shifted to lead through the poles of a
            gimbal, rad.

    Raises:
        LimitError: an axis breaks a limit.
        PlanError: the axes cannot go along it.
        ValueError: *motion* already has a path of the axes.
    """
    if not isinstance(motion.path, Path):
        raise ValueError("motion already has a path of the axes")
    count, period, times = motion.record_count, motion.period, motion.keyframe_times
    way = through_poles(axes.mechanism, Way(motion.path.trajectory, times), deviation)
    made = Path(way.trajectory, motion.path.positions)
    path, records = axes.recorded(made, count, period, way.missed)
    certificate = certificate_of(
        path, count, times, motion.request, motion.start_state, motion.limits, period, records
    )
    found = replace(
        motion,
        path=path,
        certificate=certificate,
        first_joints=records.first,
        last_joints=records.last,
    )
    return found.noted(*motion.certificate.notes, *way.notes)


def certificate_of(
    path: Path | RecordedPath,
    count: int,
    times: Floats,
    request: MotionRequest,
    start: State,
    limits: Limits,
    period: float,
    axes: AxisRecords | None = None,
) -> Certificate:
    """Return the certificate of a path, of the tool and of the axes of a device.

    Args:
        path: from start to finish, at rest.
        count: number of its records.
        times: path times of the keyframes, s.
        request: the request of the path.
        start: where it begins.
        limits: of the tool.
        period: of the device, s.
        axes: of the device, at the records.

    Raises:
        LimitError: the path breaks a limit.
    """
    # Between the records any motion may use the full limits, and one with times of the user on them
    # too.  Braking there can only use the guard's tolerance.
    peaks = measure(
        path if isinstance(path, Path) else np.ascontiguousarray(path.table[:, :STATE]),
        count,
        period,
        limits,
        before=before(start, period) if start.is_known else None,
        tolerance=GUARD_TOLERANCE,
        axes=axes,
    )
    begin, end = times[[0, -1]].tolist()
    place = refusal.Place(request, begin, end, times)
    refusal.check_limits(peaks, place)
    refusal.check_stop(peaks, place, limits)
    found = summed_up(request, path, (begin, end), times, peaks, period)
    if axes is None:
        return found
    figures, notes = summed_up_axes(axes.joints, peaks.axes)
    figures = (*found.figures, *figures, *axes.figures)
    return replace(found, figures=figures, notes=(*found.notes, *notes))


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

    times = moved(motion.keyframe_times)
    records = AxisRecords(joints, path.joint_rates, path.earlier, axes, shape.figures)
    certificate = certificate_of(
        path, len(path_times), times, request, start, motion.limits, period, records
    )
    return replace(
        motion,
        path=path,
        start_time=float(times[0]),
        end_time=float(times[-1]),
        keyframe_times=times,
        record_count=len(path_times),
        certificate=replace(
            certificate,
            losses=shape.losses,
            notes=(*motion.certificate.notes, *certificate.notes, *shape.notes),
        ),
        first_joints=tuple(joints[0].tolist()),
        last_joints=tuple(joints[-1].tolist()),
    )
