"""Connectors onto a curve that cannot be told the acceleration it should begin with.

A quintic leaves the state the device is in, which is that of the curve's beginning but for the
acceleration, and is on the curve, in step with it, a little later.
"""

from __future__ import annotations

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner.certify import limit_table
from orientd.planner.connect.quintic_connector import join, try_joins
from orientd.planner.limits import Limits
from orientd.planner.request import State
from orientd.planner.timing import KeyframePath

_TRIES = 60
_FEWEST = 2


def join_in(
    keyframe_path: KeyframePath, start: State, *, limits: Limits, period: float
) -> Trajectory:
    """Return the shortest trajectory from path time 0 by which a device gets onto a keyframe path.

    Args:
        keyframe_path: begins where the device is, with its velocity.
        start: where the device is commanded to be.
        limits: to keep, with their reserve where the keyframe path keeps it.
        period: it takes a whole number of periods, s.

    Raises:
        PlanError: none within the first interval keeps the limits.
    """
    most = int(keyframe_path.times[1] / period)
    cycles = np.unique(np.geomspace(_FEWEST, max(most, _FEWEST), _TRIES).astype(int))
    durations = period * cycles[cycles <= most]
    if len(durations):
        here = (start.q, start.omega_body, start.alpha_body)
        first = [np.tile(part, (len(durations), 1)) for part in here]
        last = keyframe_path.trajectory.sample(durations)
        # The curve may go up to the limits itself.
        w, kept = try_joins(first, last, durations, start, limit_table(limits))
        if len(kept):
            index = int(kept[0])
            return join(start.q, w[index], float(durations[index]))
    raise PlanError(
        "no way found from the acceleration the device has onto the curve; c2_cumulative begins "
        "with it, `approach: true` would lead in"
    )
