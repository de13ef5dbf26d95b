"""Lead-ins around keep-out cones to a first keyframe with a time or a velocity.

Such a lead-in comes to rest on its way: at the first keyframe, or where its run-up begins.  The
motion to that rest is planned by itself, around the cones, and the rest of the motion follows it.
"""

from __future__ import annotations

import math

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.model import Keyframe, MotionRequest
from orientd.planner.job import certified
from orientd.planner.motion import Motion
from orientd.planner.path import Path
from orientd.planner.state import State
from orientd.planner.timing import KeyframePath

_AT_REST = 1e-6  # rad/s


def rest_in_lead_in(motion: Motion) -> State:
    """Return the last state at rest in the lead-in of a motion.

    Raises:
        PlanError: it has none.
    """
    count = round(motion.start_time / motion.period) + 1
    rows = motion.rows(0, min(count, motion.record_count))
    is_resting = np.linalg.norm(rows[:, 4:7], axis=1) <= _AT_REST
    is_resting[0] = False
    if not is_resting.any():
        raise PlanError("the lead-in does not rest on its way")
    row = rows[int(np.flatnonzero(is_resting)[-1])]
    return State.at_rest(row[:4], row[10:13])


def approach_to(rest: State, request: MotionRequest) -> MotionRequest:
    """Return the request of the motion from the device's state to a rest in its lead-in."""
    w, x, y, z = rest.q.tolist()
    a, b, c = rest.position.tolist()
    place = None if request.positions is None else (a, b, c)
    return MotionRequest([Keyframe((w, x, y, z), position=place)], limits=request.limits)


def after_approach(approach: Motion, motion: Motion, start: State) -> Motion:
    """Return a motion that begins at rest, after the motion that leads there.

    Args:
        approach: ends where *motion* begins.
        motion: with its certificate.
        start: the commanded state of the device.

    Raises:
        LimitError: they break a limit together.
    """
    if not (isinstance(approach.path, Path) and isinstance(motion.path, Path)):
        raise TypeError("approach and motion must be paths, not records of a device's axes")
    period = motion.period
    begin = period * math.ceil(approach.duration / period - 1e-9)
    first, then = approach.path, motion.path
    lead = first.positions
    if not lead.is_held:
        lead = lead.slowed(begin / first.duration)
    whole = KeyframePath(
        Trajectory.joined([first.trajectory.slowed(begin), then.trajectory.shifted(begin)]),
        then.positions.delayed(begin).after(lead),
        motion.keyframe_times + begin,
        motion.certificate.notes,
    )
    joined = certified(whole, motion.request, start, motion.limits, period, motion_id=motion.id)
    return joined.noted(*motion.certificate.notes)
