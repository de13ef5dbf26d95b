"""The core of the plainest request of all, in one compiled kernel.

Keyframes without times, turns or positions, from rest to rest on the default curve: what most
retargets ask for.  What is more, or is not found at once, goes the way of
:mod:`orientd.planner.planning`, which says the same.
"""

from __future__ import annotations

import numpy as np

from orientd.curves.c2_cumulative import C2Cumulative
from orientd.curves.product import TABLE_ROWS
from orientd.planner.course import Core
from orientd.planner.fast import kernels
from orientd.planner.limit_table import limit_table
from orientd.planner.limits import Limits
from orientd.planner.methods import Ends
from orientd.planner.path import Stretch
from orientd.planner.position import PositionPath
from orientd.planner.request import MotionRequest, State
from orientd.planner.timing import LONGEST
from orientd.rotation import Floats


def quick_core(
    request: MotionRequest, start: State, ends: Ends, limits: Limits, period: float
) -> Core | None:
    """Return the shortest core through keyframes without times; ``None`` for the ordinary way.

    Args:
        request: what was asked for.
        start: where the device is commanded to be.
        ends: velocities at the first and last keyframe.
        limits: to keep.
        period: of the device, s.
    """
    compiled = kernels().quick_core
    if compiled is None or not _is_plain(request, start, ends):
        return None
    count = len(request.keys)
    times, breaks = np.empty(count), np.empty(count + 2)
    table, solved = np.empty((TABLE_ROWS, count + 1)), np.empty((count + 3, 3))
    at_ends: Floats = np.empty((10, 2))
    cycles, own = compiled(
        np.ascontiguousarray(request.keys),
        limit_table(limits),
        period,
        int(LONGEST / period),
        times,
        breaks,
        table,
        solved,
        at_ends,
    )
    if not cycles:
        return None
    duration = cycles * period
    curve = C2Cumulative.of_table(breaks, table, solved, at_ends)
    stretch = Stretch(curve, 0.0, own).slowed(duration)
    return Core(stretch, PositionPath.held(start.position), times * (duration / own))


def _is_plain(request: MotionRequest, start: State, ends: Ends) -> bool:
    moving = (ends.omega_start, ends.omega_end, ends.alpha_start)
    return (
        request.method == C2Cumulative.name
        and len(request.keys) > 2  # two are found without a search
        and request.positions is None
        and not request.options
        and not request.turns.any()
        and not start.is_position_moving
        and not any(vector is not None and vector.any() for vector in moving)
    )
