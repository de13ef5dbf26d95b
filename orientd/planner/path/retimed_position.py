"""Positions on another clock: the same points, at the pace that the orientation has been given."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orientd.planner.path.position import PositionPath, quintics
from orientd.rotation import Floats

Clock = Callable[[Floats], tuple[Floats, Floats, Floats]]
"""Gives a path time and its first two derivatives by another time: a ``TimeMap``, for example."""


def repositioned(positions: PositionPath, clock: Clock, times: Floats) -> PositionPath:
    """Return the positions on another clock, quintic between *times* on that clock, s."""
    if positions.is_held:
        return positions
    s, rate, change = clock(times)
    p = positions.sample(s)[0]
    velocity, acceleration = positions.motion(s)
    v = velocity * rate[:, None]
    a = acceleration * rate[:, None] ** 2 + velocity * np.nan_to_num(change)[:, None]
    # It may go on from a motion, and ends at rest.
    _, velocity_0, acceleration_0 = positions.state(0.0)
    v[0], a[0] = velocity_0 * rate[0], acceleration_0 * rate[0] ** 2
    a[0] += velocity_0 * np.nan_to_num(change[0])
    v[-1] = a[-1] = 0.0
    coefficients = quintics(np.diff(times), p, v, a)
    return PositionPath(times, coefficients, positions.first, positions.last)
