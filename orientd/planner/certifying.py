"""From a candidate to a motion: its records, held against the limits."""

from __future__ import annotations

import math

from orientd.planner import refusal
from orientd.planner.candidate import CandidateMotion
from orientd.planner.certify import before, measure_path, summed_up
from orientd.planner.limits import Limits
from orientd.planner.motion import Motion
from orientd.planner.request import MotionRequest, State
from orientd.tolerances import GUARD_TOLERANCE

_END_SLACK = 1e-9  # of a period


def certified(
    candidate: CandidateMotion,
    request: MotionRequest,
    start: State,
    limits: Limits,
    period: float,
    *,
    motion_id: str,
) -> Motion:
    """Return the motion of a candidate, held against its limits on the records that will be sent.

    Args:
        candidate: from hold to hold, or from the state it takes over.
        request: what it was made for.
        start: where the device is commanded to be.
        limits: to keep.
        period: of the device, s.
        motion_id: names the motion.

    Raises:
        LimitError: it breaks one.
    """
    path = candidate.path
    count = math.ceil(path.duration / period - _END_SLACK) + 1

    # Between the records any motion may go up to the limits, a timing of the user's on them, too;
    # the guard's tolerance is all that is left to brake with there.
    core = candidate.keyframe_path
    known = None if core is None else core.found_as_whole(path, start, period, limits)
    peaks = known or measure_path(
        path,
        count,
        period,
        limits,
        before=before(start, period) if start.is_known else None,
        brake_limits=limits.scaled(GUARD_TOLERANCE),
        rough=candidate.rough,
    )
    place = refusal.Place(request, candidate.begin, candidate.end, candidate.keyframe_times)
    refusal.check_limits(peaks, place)
    refusal.check_stop(peaks, place)
    return Motion(
        id=motion_id,
        request=request,
        limits=limits,
        period=period,
        path=path,
        start_time=candidate.begin,
        end_time=candidate.end,
        keyframe_times=candidate.keyframe_times,
        record_count=count,
        certificate=summed_up(
            request, path, (candidate.begin, candidate.end), candidate.keyframe_times, peaks, period
        ),
        rough=candidate.rough,
        before=start.before,
    )
