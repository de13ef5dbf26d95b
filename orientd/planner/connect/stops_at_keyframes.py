"""Motions that stop at every keyframe: no curve need take longer."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from orientd.curves import Trajectory
from orientd.planner.connect.leads import approach
from orientd.planner.limits import Limits
from orientd.planner.methods import Ends
from orientd.planner.path import PositionPath
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, State
from orientd.planner.timing import KeyframePath, least_with_stops
from orientd.rotation import Floats

STOPS = "stops at every keyframe: this takes less time than the curve through them"


def stops_take(keys: Floats, limits: Limits) -> float:
    """Return how long the turns from keyframe to keyframe take, from rest to rest, s.

    Args:
        keys: orientations, shape ``(n, 4)``.
        limits: to keep.

    Raises:
        PlanError: one of them takes longer than is planned.
    """
    turns = [approach(here, there, limits) for here, there in pairwise(keys)]
    return sum(turn.duration for turn in turns if turn is not None)


def turns_with_stops(
    request: MotionRequest,
    ends: Ends,
    start: State,
    limits: Limits,
    shorter_than: float,
    jerk_share: float,
) -> KeyframePath | None:
    """Return the turns from keyframe to keyframe, from rest to rest, if they take less time.

    Where the curve has to turn on the spot, or nearly so, they are quicker.

    Args:
        request: without times.
        ends: velocities at the first and last keyframe.
        start: where the device is commanded to be.
        limits: to keep.
        shorter_than: the time to beat, s.
        jerk_share: of the jerk to use.

    Raises:
        PlanError: one of them takes longer than is planned.
    """
    is_plain = request.method == DEFAULT_METHOD and request.total is None
    is_held = request.positions is None and not request.turns.any()
    if not (is_plain and is_held) or any(ends.moves):
        return None
    if least_with_stops(request.keys, limits) >= shorter_than:
        return None
    parts: list[Trajectory] = []
    times = [0.0]
    for here, there in pairwise(request.keys):
        turn = approach(here, there, limits, jerk_share=jerk_share)
        if turn is not None:
            parts.append(turn.shifted(times[-1]))
        times.append(parts[-1].domain[1] if parts else 0.0)
    if not parts or times[-1] >= shorter_than:
        return None
    held = PositionPath.held(start.position)
    return KeyframePath(Trajectory.joined(parts), held, np.array(times))
