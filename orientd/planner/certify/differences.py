"""What a device sees of setpoints: their backward differences, and the largest of these.

A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to the
next over a period for the velocity, the change of that for the acceleration and the change of that
for the jerk, so this is what is held against the limits: on the very records that are sent while a
motion runs as planned, and at shares of a period after these on what the servo draws between them,
which is sent after a pause, a stop or another speed.  (At constant rates below 1 nothing was found
to have larger differences than the largest of all phases at rate 1.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd import kernels
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.planner.certify.limit_tables import limit_table
from orientd.planner.limits import ANGULAR, Limits
from orientd.planner.recorded import HISTORY
from orientd.rotation import Floats

OFF_GRID = {0: (2.0, 2.0), 1: (1.0, 1.5), 2: (1.0, 1.0)}
"""By how much acceleration and jerk can be larger between the records of a curve, by continuity.

A stop on the path leaves the grid of records.  A step of the acceleration then falls elsewhere
between two setpoints, and its share in the third difference, the quadratic B-spline at that place,
varies from 1/2 to 3/4; that of a step of the velocity in second and third varies from 1/2 to 1.
"""


@dataclass(frozen=True, slots=True)
class Rough:
    """A part of a path that is less than twice continuously differentiable.

    Attributes:
        begin: path time of the first step of a derivative, s.
        end: path time of the last one, s.
        continuity: how many derivatives of the orientation are continuous.
    """

    begin: float
    end: float
    continuity: int


@dataclass(frozen=True, slots=True)
class Extremes:
    """What a certificate takes of some setpoints.

    Attributes:
        largest: squares of the largest backward differences, in units of rad a period: of the
            norm, and of the components where they are wanted, shape ``(6, 4)``; the last three rows
            are those on the records alone.
        places: where these are, shape ``(3, 4)``.
        rate: the least brake rate, 1/s, where it is wanted.
        rate_place: which third difference sets it.
    """

    largest: list[list[float]]
    places: list[list[int]]
    rate: float = FASTEST_BRAKE_RATE
    rate_place: int = 0

    def peak(self, order: int, column: int, first: int) -> tuple[float, int]:
        """Return the largest square, and its record where that of the first setpoint is *first*."""
        return self.largest[order][column], first + order + 1 + self.places[order][column]

    def on_records(self, order: int, column: int) -> float:
        """Return the largest square on the records alone."""
        return self.largest[len(ANGULAR) + order][column]


def extremes(
    q: Floats,
    *,
    past: int = 0,
    with_axes: bool = False,
    period: float = 1.0,
    start: float = 0.0,
    rough: Rough | None = None,
    brake_limits: Limits | None = None,
) -> Extremes:
    """Return the largest backward differences of orientations, and the least brake rate.

    Args:
        q: orientations on the records, shape ``(n, 4)``; or with angular velocities, rad/s, and
            accelerations, rad/s^2, shape ``(n, 10)``, where what is drawn between the records is to
            count, too.  The first records may have no velocities, which are not numbers then.
        past: how many accelerations, and twice as many velocities, do not count as largest.
        with_axes: whether the largest components are wanted, too.
        period: from one setpoint to the next, s.
        start: path time of the fourth setpoint, s.
        rough: where the brake rate must expect more between the records than on them.
        brake_limits: limits for the brake rate; ``None`` leaves it out.
    """
    squares, places = np.zeros((6, 4)), np.zeros(12, dtype=np.int64)
    rate, place = kernels.setpoint_extremes(
        np.ascontiguousarray(q.T),
        past,
        with_axes or (brake_limits is not None and brake_limits.has_axes),
        period,
        start,
        _reach(rough, period),
        brake_limits is not None,
        _NO_LIMITS if brake_limits is None else limit_table(brake_limits)[1:],
        *LAW,
        squares,
        places,
    )
    return Extremes(squares.tolist(), places.reshape(3, 4).tolist(), rate, place)


_SMOOTH = np.array([np.inf, -np.inf, 1.0, 1.0])
_NO_LIMITS = np.full((2, 4), np.inf)


def _reach(rough: Rough | None, period: float) -> Floats:
    """Return from when to when differences see a rough part, and how much larger they may be."""
    if rough is None:
        return _SMOOTH
    return np.array([rough.begin, rough.end + HISTORY * period, *OFF_GRID[rough.continuity]])
