"""Make the certificate of a checked path, and the setpoints before it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from math import degrees

import numpy as np

from orientd.curves.contract import METHODS
from orientd.mechanism.figure import Figure
from orientd.mechanism.joint_path import AxisPeak
from orientd.model.limits import ANGULAR, AXES, UNITS
from orientd.model.request import MotionRequest
from orientd.planner.certify.certificate import Certificate, Peak
from orientd.planner.certify.measuring import Peaks
from orientd.planner.facts import HISTORY
from orientd.planner.path import Path, RecordedPath
from orientd.planner.state import State
from orientd.rotation import Floats, angle, exp, multiply


def summed_up(
    request: MotionRequest,
    path: Path | RecordedPath,
    ends: tuple[float, float],
    keyframe_times: Floats,
    peaks: Peaks,
    period: float,
) -> Certificate:
    """Return the certificate of a path that keeps its limits.

    Args:
        request: the request of the path.
        path: from start to finish, at rest.
        ends: path times of the first keyframe and of the last, s.
        keyframe_times: path times of all keyframes, s.
        peaks: bounds of the path.
        period: of the device, s.
    """
    begin, end = ends
    # No stop lasts longer than the rest of the motion.
    stop_time = min(1.0 / peaks.brake_rate, path.duration) if peaks.brake_rate else math.inf
    at = path.sample(np.concatenate([[begin, end], keyframe_times]))
    asked = request.omega_start, request.omega_end
    missed = [
        0.0 if omega is None else float(np.linalg.norm(found - omega))
        for omega, found in zip(asked, at.omega_body[:2], strict=True)
    ]
    return Certificate(
        rate_hz=1.0 / period,
        duration=path.duration,
        lead_in=begin,
        lead_out=path.duration - end,
        peak_velocity=peaks.velocity,
        peak_acceleration=peaks.acceleration,
        peak_jerk=peaks.jerk,
        peak_linear_velocity=peaks.linear_velocity,
        peak_linear_acceleration=peaks.linear_acceleration,
        start_velocity_error=missed[0],
        end_velocity_error=missed[1],
        keyframe_error=float(np.max(angle(at.q[2:], request.keys))),
        brake_rate=peaks.brake_rate,
        stop_time=stop_time,
        usual_stop_time=min(peaks.usual_stop_time, stop_time),
        has_control_points=not METHODS[request.method].interpolates,
        figures=tuple(_axis_figures(peaks)),
        notes=_notes(peaks),
    )


def _notes(peaks: Peaks) -> tuple[str, ...]:
    if not peaks.unproven:
        return ()
    return (
        f"peaks are sampled, not proven, in {peaks.unproven} places: these turn by more than "
        "0.5 rad a period, or a proof takes too long; at most 0.36 of a period lies between two "
        "samples",
    )


def _axis_figures(peaks: Peaks) -> Iterator[Figure]:
    for name in ANGULAR:
        of_axes: tuple[Peak, ...] = getattr(peaks, f"axis_{name}")
        for axis, peak in zip(AXES, of_axes, strict=False):
            if math.isfinite(peak.limit):
                words = f"angular {name} about {axis}"
                yield Figure(words, peak.value, UNITS[name], peak.limit, peak.time)


def summed_up_axes(
    joints: Floats, peaks: Sequence[AxisPeak]
) -> tuple[tuple[Figure, ...], tuple[str, ...]]:
    """Return figures and notes about the axes of a device on a path.

    Args:
        joints: their angles at the records, rad, shape ``(n, axes)``.
        peaks: their proven peaks.
    """
    figures, notes = list[Figure](), list[str]()
    low, high = joints.min(axis=0).tolist(), joints.max(axis=0).tolist()
    for place, axis in enumerate(dict.fromkeys(peak.axis for peak in peaks)):
        own = [peak for peak in peaks if peak.axis == axis]
        figures += [
            Figure(f"{kind.value} of {axis.name}", value, UNITS[kind.value], limit, time)
            for kind, _, value, limit, time in own
        ]
        figures += [
            Figure(f"least angle of {axis.name}", low[place], "rad", axis.low),
            Figure(f"largest angle of {axis.name}", high[place], "rad", axis.high),
        ]
        speed, force, *_ = own
        notes.append(
            f"{axis.name}: {_tenths(low[place])} to {_tenths(high[place])} deg, at most "
            f"{degrees(speed.value):.1f} deg/s at {speed.time:.3f} s (limit "
            f"{degrees(speed.limit):.1f}), {degrees(force.value):.0f} deg/s^2 at {force.time:.3f} s"
        )
    return tuple(figures), tuple(notes)


def _tenths(angle: float) -> str:
    """Return an angle in degrees with one decimal, and without a negative zero."""
    return f"{round(degrees(angle), 1) + 0.0:.1f}"


def before(start: State, period: float) -> tuple[Floats, Floats]:
    """Return the setpoints of the device before path time 0, oldest first.

    If they are unknown, the acceleration is assumed constant.
    """
    if start.before is not None:
        return start.before
    if start.is_at_rest:
        return np.array([start.q] * HISTORY), np.array([start.position] * HISTORY)
    back = -period * np.arange(HISTORY, 0, -1.0)[:, None]
    turn = start.omega_body * back + 0.5 * start.alpha_body * back**2
    move = start.velocity * back + 0.5 * start.acceleration * back**2
    return multiply(start.q, exp(turn)), start.position + move
