"""Candidate motions: a keyframe path with its leads, not yet held against the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.certify import Rough
from orientd.planner.connect import (
    Caution,
    LeadIn,
    approach,
    join_in,
    lead_in,
    lead_out,
    position_lead,
)
from orientd.planner.limits import Limits, is_still
from orientd.planner.path import Path, PositionPath, end_states
from orientd.planner.request import MotionRequest, State
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
    request: MotionRequest,
    start: State,
    limits: Limits,
    own: Limits,
    period: float,
    caution: Caution = Caution.NONE,
    *,
    is_even: bool,
    share: float,
    jerk_share: float,
) -> CandidateMotion:
    """Return the path to a single keyframe, and to rest behind it if it is passed.

    Args:
        request: of one keyframe.
        start: where the device is commanded to be.
        limits: to keep.
        own: as for :func:`.lead_in`.
        period: of the device, s.
        caution: how to lead in.
        is_even: whether to keep the reserve of an even pace from rest, too.
        share: of the acceleration to use from rest to rest.
        jerk_share: of the jerk.

    Raises:
        PlanError: the end velocity is one that the limits do not permit.
    """
    omega = np.zeros(3) if request.omega_end is None else request.omega_end
    position = position_lead(start, None, limits=limits, period=period).last
    if request.positions is not None:
        position = request.positions[0]
    target = State(request.keys[0], omega, np.zeros(3), position)
    is_from_rest = start.is_at_rest and not omega.any()
    is_free = is_from_rest and bool((position == start.position).all())
    turn, total = None, request.total
    if is_free and not (is_even and total is None):
        turn = approach(
            start.q,
            target.q,
            limits,
            is_even=is_even,
            share=share,
            jerk_share=jerk_share,
            is_part=False,
        )
    if total is not None:
        if turn is None:
            raise PlanError("a single keyframe is reached in a duration by turning from rest only")
        refusal.check_total(total, turn.duration)
        turn = turn.slowed(max(total, turn.duration))
    if turn is not None:
        # It need not take a whole number of periods: nothing comes after it.
        path = Path.joined([turn], PositionPath.held(position), start.q)
        end = turn.duration
        return CandidateMotion(path, end, end, np.array([end]), None)
    is_direct = is_even or is_free or not is_from_rest
    lead = lead_in(
        start,
        target,
        limits=limits,
        own=own,
        period=period,
        is_direct=is_direct,
        caution=caution,
        is_even=is_even,
    )
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
        lead = lead_out(last.q, last.omega_body, last.alpha_body, limits=limits, period=period)
    except PlanError as error:
        raise PlanError(f"no lead-out from the last keyframe: {error}") from error
    return [lead.shifted(end)]


def _rough(keyframe_path: KeyframePath, begin: float) -> Rough | None:
    """Return where a keyframe path's derivatives have steps: first inner knot to last."""
    knots = keyframe_path.trajectory.knots
    if keyframe_path.continuity >= 2 or len(knots) < 3:
        return None
    return Rough(begin + float(knots[1]), begin + float(knots[-2]), keyframe_path.continuity)
