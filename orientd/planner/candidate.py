"""Candidate motions: a keyframe path with its leads, not yet held against the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.certify import Rough
from orientd.planner.connect import LeadIn, join_in, lead_out
from orientd.planner.limits import Limits, is_still
from orientd.planner.path import Path, end_states
from orientd.planner.request import State
from orientd.planner.timing import KeyframePath
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True, eq=False)
class CandidateMotion:
    """A path that has not been checked yet.

    Attributes:
        path: from hold to hold.
        begin: path time of the first keyframe, s; a whole number of periods.
        end: path time of the last keyframe, s.
        keyframe_times: path times of all keyframes, s.
        rough: the part whose acceleration has steps; ``None`` if there is none.
        keyframe_path: from the first keyframe to the last; ``None`` for a single keyframe.
    """

    path: Path
    begin: float
    end: float
    keyframe_times: Floats
    rough: Rough | None
    keyframe_path: KeyframePath | None = None


def with_leads(
    keyframe_path: KeyframePath,
    lead: LeadIn | None,
    start: State,
    limits: Limits,
    period: float,
) -> CandidateMotion:
    """Return the path from hold to hold around a keyframe path.

    In front goes the lead-in; behind goes a lead-out if the keyframe path does not end at rest.

    Args:
        keyframe_path: from the first keyframe to the last.
        lead: from where the device is to the first keyframe; ``None`` where the keyframe path is to
            begin right there.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.

    Raises:
        StartError: there is no lead-in, and the keyframe path begins elsewhere.
        PlanError: no lead keeps the limits.
    """
    first, last = end_states(keyframe_path.trajectory)
    parts: list[Trajectory] = []
    positions, begin, core = keyframe_path.positions, 0.0, keyframe_path.trajectory
    rough = _rough(keyframe_path, 0.0)
    if lead is not None:
        begin = lead.cycles * period
        parts += lead.parts
        positions = positions.delayed(begin).after(lead.positions)
        core = core.shifted(begin)
        rough = _rough(keyframe_path, begin)
    elif start.is_at_rest or keyframe_path.has_acceleration_of(start, limits):
        state = State(first.q, first.omega_body, first.alpha_body, *positions.state(0.0))
        refusal.check_start(start, state, limits)
    else:
        # The keyframe path knows nothing of the acceleration the device has.
        joint = join_in(keyframe_path, start, limits=limits, period=period)
        parts.append(joint)
        core = core.restricted(joint.duration, core.duration)
    end = begin + keyframe_path.duration
    parts += [core, *leads_out(last, end, limits, period)]
    path = Path.joined(parts, positions, start.q)
    return CandidateMotion(path, begin, end, keyframe_path.times + begin, rough, keyframe_path)


def to_single(
    target: State, lead: LeadIn, start: State, limits: Limits, period: float
) -> CandidateMotion:
    """Return the path to a single keyframe, and to rest behind it if it is passed.

    Args:
        target: the state at the keyframe.
        lead: to that.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.

    Raises:
        PlanError: the end velocity is one that the limits do not permit.
    """
    end = lead.cycles * period
    parts = [*lead.parts, *leads_out(target, end, limits, period)]
    path = Path.joined(parts, lead.positions, start.q)
    return CandidateMotion(path, end, end, np.array([end]), None)


def leads_out(last: State, end: float, limits: Limits, period: float) -> list[Trajectory]:
    """Return what leads to rest from a state at a path time; nothing if it is at rest.

    Raises:
        PlanError: no lead-out keeps the limits.
    """
    if is_still(last.omega_body, last.alpha_body, limits):
        return []
    try:
        lead = lead_out(last, limits=limits, period=period)
    except PlanError as error:
        raise PlanError(f"no lead-out from the last keyframe: {error}") from error
    return [lead.shifted(end)]


def _rough(keyframe_path: KeyframePath, begin: float) -> Rough | None:
    """Return where a keyframe path's derivatives have steps: first inner knot to last."""
    knots = keyframe_path.trajectory.knots
    if keyframe_path.continuity >= 2 or len(knots) < 3:
        return None
    return Rough(begin + float(knots[1]), begin + float(knots[-2]), keyframe_path.continuity)
