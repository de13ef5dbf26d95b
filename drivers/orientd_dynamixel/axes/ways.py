"""Ways for the axes where the shortest turn of the tool is none: unwinding, and home."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import Quaternion
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.tracker import AxisTracker

_STEP = math.radians(30)
"""What no axis turns more than from one orientation to the next, so that none is a half turn."""
_TURN = 2 * math.pi


def home(options: GimbalOptions) -> tuple[float, ...]:
    """Return the axis angles that are home: zero, or as near to it as the limits permit, rad."""
    return tuple(min(max(0.0, axis.low), axis.high) for axis in options.axes)


def windings(
    options: GimbalOptions, tracker: AxisTracker, q: Quaternion
) -> list[tuple[float, ...]]:
    """Return the axis angles inside the limits that make *q*, nearest ones of each branch, rad."""
    found = []
    for branch in tracker.branches(q):
        nearest = []
        for angle, near, axis in zip(branch, tracker.angles, options.axes, strict=True):
            least = math.ceil((axis.low - angle) / _TURN)
            most = math.floor((axis.high - angle) / _TURN)
            if least <= most:
                count = min(max(round((near - angle) / _TURN), least), most)
                nearest.append(angle + _TURN * count)
        if len(nearest) == len(branch):
            found.append(tuple(nearest))
    return found


def passing(tracker: AxisTracker, begin: Sequence[float], end: Sequence[float]) -> list[Quaternion]:
    """Return the orientations to pass, the first one included, while all axes turn evenly."""
    farthest = max(abs(b - a) for a, b in zip(begin, end, strict=True))
    count = max(1, math.ceil(farthest / _STEP))
    return [
        tracker.forward([a + (b - a) * k / count for a, b in zip(begin, end, strict=True)])
        for k in range(count + 1)
    ]


def way(
    options: GimbalOptions, joints: tuple[float, ...], q: Quaternion, *, is_homing: bool
) -> list[Quaternion]:
    """Return the orientations to pass from *joints* to *q*, or home; see :meth:`.Driver.way`."""
    tracker = AxisTracker(options.order, options.mount, options.tool, is_pointing=options.pointing)
    tracker.angles = joints
    ends = [home(options)] if is_homing else windings(options, tracker, q)

    def travel(end: Sequence[float]) -> float:
        return sum(abs(a - b) for a, b in zip(joints, end, strict=True))

    return passing(tracker, joints, min(ends, key=travel)) if ends else []
