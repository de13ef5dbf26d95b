"""The largest rates of a motion, each with where it is and what was allowed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, brake_rate
from orientd.planner.certify.certificate import Peak
from orientd.planner.certify.differences import Extremes
from orientd.planner.limits import ANGULAR, Limits
from orientd.planner.recorded import HISTORY
from orientd.rotation import Floats

Largest = tuple[float, int]
"""A squared rate and the record where it is."""


@dataclass(frozen=True, slots=True)
class Peaks:
    """Bounds of the rates over a segment of records, by backward differences.

    Attributes:
        velocity: angular, rad/s.
        acceleration: angular, rad/s^2.
        jerk: angular, rad/s^3.
        linear_velocity: of the position, m/s.
        linear_acceleration: of the position, m/s^2.
        brake_rate: largest safe brake rate, 1/s.
        brake_time: path time of the record that sets it, s.
        axis_velocity: components of the angular velocity in the body frame, rad/s; empty where
            none is limited by itself, as the next two.
        axis_acceleration: of the angular acceleration, rad/s^2.
        axis_jerk: of the angular jerk, rad/s^3.
        unproven: places without a proof, where peaks are sampled.
    """

    velocity: Peak
    acceleration: Peak
    jerk: Peak
    linear_velocity: Peak
    linear_acceleration: Peak
    brake_rate: float
    brake_time: float
    axis_velocity: tuple[Peak, ...] = ()
    axis_acceleration: tuple[Peak, ...] = ()
    axis_jerk: tuple[Peak, ...] = ()
    unproven: int = 0

    @property
    def spins(self) -> float:
        """The largest angular velocity as a share of its limits, of the norm and of the axes."""
        return max(peak.planned_ratio for peak in (self.velocity, *self.axis_velocity))

    @property
    def bends(self) -> float:
        """The same of the angular acceleration."""
        return max(peak.planned_ratio for peak in (self.acceleration, *self.axis_acceleration))

    @property
    def twists(self) -> float:
        """The same of the angular jerk."""
        return max(peak.planned_ratio for peak in (self.jerk, *self.axis_jerk))

    @property
    def drawn(self) -> tuple[float, float, float]:
        """The same three shares of what the servo draws between the records."""
        return (
            max(peak.ratio for peak in (self.velocity, *self.axis_velocity)),
            max(peak.ratio for peak in (self.acceleration, *self.axis_acceleration)),
            max(peak.ratio for peak in (self.jerk, *self.axis_jerk)),
        )


class Tally:
    """The largest rates of records that are looked at one part after the other.

    Args:
        period: from one record to the next, s.
        limits: what the peaks are held against.
    """

    def __init__(self, period: float, limits: Limits) -> None:
        self._period, self._limits = period, limits
        # In units of rad or m a period: the powers of the period come in once, at the end.
        columns = 4 if limits.has_axes else 1
        self._turns = [[_NONE] * columns for _ in ANGULAR]
        self._planned = [[_NONE] * columns for _ in ANGULAR]
        self._move, self._push = _NONE, _NONE
        self._slowest, self._slowest_record = FASTEST_BRAKE_RATE, 0
        self._unproven = 0

    def note_turns(self, found: Extremes, first: int) -> None:
        """Take in what was found of orientations, the first of which is that of record *first*."""
        for order, row in enumerate(self._turns):
            for column, largest in enumerate(row):
                row[column] = _larger(largest, found.peak(order, column, first))
                planned = self._planned[order]
                planned[column] = _larger(planned[column], (found.on_records(order, column), 0))
        self._note_rate(found.rate, first + HISTORY + found.rate_place)
        self._unproven += found.unproven

    def note_moves(
        self, positions: Floats, first: int, *, past: int, brake_limits: Limits | None
    ) -> None:
        """Take in positions.

        Args:
            positions: shape ``(n, 3)``, m.
            first: the record that the first of them is of.
            past: how many accelerations, and twice as many velocities, do not count.
            brake_limits: limits for the brake rate; ``None`` leaves it out.
        """
        v = np.diff(positions, axis=0)
        a = np.diff(v, axis=0)
        self._move = _larger(self._move, *_largest(v[2 * past :], first + 1 + 2 * past))
        self._push = _larger(self._push, *_largest(a[past:], first + 2 + past))
        if brake_limits is not None:
            velocity, push = v[1 + past :] / self._period, a[past:] / self._period**2
            most = brake_limits.linear_acceleration
            rate, place = brake_rate(velocity, push, np.zeros(len(push)), most, math.inf)
            self._note_rate(rate, first + 2 + past + place)

    def _note_rate(self, rate: float, record: int) -> None:
        if rate < self._slowest:
            self._slowest, self._slowest_record = rate, record

    def peaks(self) -> Peaks:
        """Return the largest of all."""
        limits = self._limits
        (turn, *turns), (bend, *bends), (twist, *twists) = self._turns
        return Peaks(
            self._turn(turn, 0, limits.velocity, 1),
            self._turn(bend, 0, limits.acceleration, 2),
            self._turn(twist, 0, limits.jerk, 3),
            self._peak(self._move, limits.linear_velocity, 1),
            self._peak(self._push, limits.linear_acceleration, 2),
            self._slowest,
            self._slowest_record * self._period,
            self._peaks(turns, limits.axis_velocity, 1),
            self._peaks(bends, limits.axis_acceleration, 2),
            self._peaks(twists, limits.axis_jerk, 3),
            self._unproven,
        )

    def _peak(self, largest: Largest, limit: float, power: int) -> Peak:
        square, record = largest
        return Peak(math.sqrt(square) / self._period**power, record * self._period, limit)

    def _peaks(self, row: list[Largest], limits: tuple[float, ...], power: int) -> tuple[Peak, ...]:
        return tuple(
            self._turn(one, column, limit, power)
            for column, (one, limit) in enumerate(zip(row, limits, strict=False), 1)
        )

    def _turn(self, largest: Largest, column: int, limit: float, power: int) -> Peak:
        planned = self._peak(self._planned[power - 1][column], limit, power)
        return replace(self._peak(largest, limit, power), on_records=planned.value)


_NONE: Largest = (0.0, 0)


def _larger(here: Largest, *others: Largest) -> Largest:
    """Return the largest of some; what is not a number must not pass for small."""
    for other in others:
        # Not `>`, nor may it be forgotten.
        if not other[0] <= here[0] and here[0] < math.inf:
            here = other
    return here


def _largest(vectors: Floats, first: int) -> list[Largest]:
    """Return the largest of the vectors of the records from *first* on, if there are any."""
    if not len(vectors):
        return []
    squares = np.einsum("ij,ij->i", vectors, vectors)
    place = int(np.argmax(squares))
    return [(float(squares[place]), first + place)]
