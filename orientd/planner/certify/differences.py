r"""Bounds of what a device sees of setpoints: their backward differences.

A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to the
next over a period for the velocity, the change of that for the acceleration and the change of that
for the jerk, so this is what is held against the limits: on the very records that are sent while a
motion runs as planned, and on the path between them (:mod:`orientd.servo.path.segment`), which is
sent after a pause, a stop or at another speed.

A certificate's bounds of velocity, acceleration and jerk, of the norm and of the components, are
*proven* for setpoints a constant share of a period apart on the path: for every phase against the
records and every rate in [0, 1].  They are at most :math:`3 \cdot 10^{-4}` above a value that is
reached; that of a component far below the norm may be looser, where it takes too long to refine.
First differences are averages of the velocity, second ones of the acceleration and third ones of
the jerk, but for what rotations fail to commute by, which is bounded (``kernels/c/segments.c``,
``enclosure.c``); at the rate 1 they are polynomials of the phase but for a bounded rest, and lie in
the hull of their Bernstein coefficients.  Bounds are of exact arithmetic: rounding adds some 1e-15
rad.

What is *sampled*, at the records and three phases between them, at most 0.36 of a period apart:

- periods in which the path turns by more than 0.5 rad, of which the certificate has a note;
- what the brake rate follows from;
- everything where no certificate is asked for.

Positions, and differences that reach back to records of which only the orientation is known, are
looked at on the records alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd import kernels
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, LAW
from orientd.planner.certify.limit_tables import limit_table
from orientd.planner.limits import ANGULAR, Limits
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
        largest: squares of bounds of the backward differences, in units of rad a period: of the
            norm, and of the components where they are wanted, shape ``(6, 4)``; the last three rows
            are the largest ones on the records alone.
        places: where these are about, shape ``(3, 4)``.
        rate: the least brake rate, 1/s, where it is wanted.
        rate_place: which third difference sets it.
        unproven: places without a proof: periods that turn too far, and bounds that take too long.
    """

    largest: list[list[float]]
    places: list[list[int]]
    rate: float = FASTEST_BRAKE_RATE
    rate_place: int = 0
    unproven: int = 0

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
    brake_limits: Limits | None = None,
    so_far: Extremes | None = None,
) -> Extremes:
    """Return bounds of the backward differences of orientations, and the least brake rate.

    Args:
        q: orientations on the records, shape ``(n, 4)``; or with angular velocities, rad/s, and
            accelerations, rad/s^2, shape ``(n, 10)``, where the path between the records is to
            count, too.  The first records may have no velocities, which are not numbers then.
        past: how many accelerations, and twice as many velocities, do not count as largest.
        with_axes: whether bounds of the components are wanted, too.
        period: from one setpoint to the next, s.
        brake_limits: limits for the brake rate, for a certificate; with ``None`` there is none, and
            differences are sampled.
        so_far: bounds of records before these, which are taken in.
    """
    squares = np.zeros((6, 4)) if so_far is None else np.array(so_far.largest)
    places = np.zeros(12, dtype=np.int64)
    rate, place, unproven = kernels.certify(
        np.ascontiguousarray(q.T),
        past,
        with_axes or (brake_limits is not None and brake_limits.has_axes),
        brake_limits is not None,
        period,
        _NO_LIMITS if brake_limits is None else limit_table(brake_limits)[1:],
        *LAW,
        squares,
        places,
    )
    return Extremes(squares.tolist(), places.reshape(3, 4).tolist(), rate, place, unproven)


_NO_LIMITS = np.full((2, 4), np.inf)
