"""Positions on another clock: the same points, at the pace that the orientation has been given."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from orientd.planner.path.position import PositionPath, quintics
from orientd.rotation import Floats


class Clock(Protocol):
    """A path time by another one: a ``TimeMap``, for example."""

    @property
    def times(self) -> Floats:
        """Its own, between which positions are a quintic."""

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the path time and its first two derivatives."""


def repositioned(positions: PositionPath, clock: Clock) -> PositionPath:
    """Return the positions on another clock, quintic from node to node."""
    if positions.is_held:
        return positions
    times = clock.times
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
