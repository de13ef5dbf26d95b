"""The largest rates of a motion, each with where it is and what was allowed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orientd.planner.brake import FASTEST_BRAKE_RATE, linear_brake_rate
from orientd.planner.differences import HISTORY, Extremes
from orientd.planner.limits import ANGULAR, Limits
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True)
class Peak:
    """The largest value of a quantity.

    Attributes:
        value: in SI units.
        time: path time of the record where it occurs, s.
        limit: what was allowed.
    """

    value: float
    time: float
    limit: float

    @property
    def ratio(self) -> float:
        """The value as a share of the limit."""
        return self.value / self.limit


@dataclass(frozen=True, slots=True)
class Peaks:
    """The largest rates over a stretch of records, by backward differences.

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

    @property
    def spins(self) -> float:
        """The largest angular velocity as a share of its limits, of the norm and of the axes."""
        return max(peak.ratio for peak in (self.velocity, *self.axis_velocity))

    @property
    def bends(self) -> float:
        """The same of the angular acceleration."""
        return max(peak.ratio for peak in (self.acceleration, *self.axis_acceleration))

    @property
    def twists(self) -> float:
        """The same of the angular jerk."""
        return max(peak.ratio for peak in (self.jerk, *self.axis_jerk))


class Tally:
    """The largest rates of records that are looked at one part after the other.

    Args:
        period: from one record to the next, s.
        limits: what the peaks are held against.
    """

    def __init__(self, period: float, limits: Limits) -> None:
        self._period, self._limits = period, limits
        # In units of rad or m a period: the powers of the period come in once, at the end.
        self._turns = [[_Largest() for _ in range(4 if limits.has_axes else 1)] for _ in ANGULAR]
        self._move, self._push = _Largest(), _Largest()
        self._slowest, self._slowest_record = FASTEST_BRAKE_RATE, 0

    def note_turns(self, found: Extremes, first: int) -> None:
        """Take in what was found of orientations, the first of which is that of record *first*."""
        for order, row in enumerate(self._turns):
            for column, largest in enumerate(row):
                largest.note(*found.peak(order, column, first))
        self._note_rate(found.rate, first + HISTORY + found.rate_place)

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
        self._move.see(v[2 * past :], first + 1 + 2 * past)
        self._push.see(a[past:], first + 2 + past)
        if brake_limits is not None:
            rate, place = linear_brake_rate(
                v[1 + past :] / self._period, a[past:] / self._period**2, brake_limits
            )
            self._note_rate(rate, first + 2 + past + place)

    def _note_rate(self, rate: float, record: int) -> None:
        if rate < self._slowest:
            self._slowest, self._slowest_record = rate, record

    def peaks(self) -> Peaks:
        """Return the largest of all."""
        limits, period = self._limits, self._period
        (turn, *turns), (bend, *bends), (twist, *twists) = self._turns
        return Peaks(
            turn.peak(limits.velocity, period, 1),
            bend.peak(limits.acceleration, period, 2),
            twist.peak(limits.jerk, period, 3),
            self._move.peak(limits.linear_velocity, period, 1),
            self._push.peak(limits.linear_acceleration, period, 2),
            self._slowest,
            self._slowest_record * period,
            _peaks(turns, limits.axis_velocity, period, 1),
            _peaks(bends, limits.axis_acceleration, period, 2),
            _peaks(twists, limits.axis_jerk, period, 3),
        )


class _Largest:
    """A running maximum with the record where it was reached."""

    __slots__ = ("_record", "_square")

    def __init__(self) -> None:
        self._square, self._record = 0.0, 0

    def see(self, vectors: Floats, first: int) -> None:
        """Take in the vectors of the records from *first* on."""
        if len(vectors):
            squares = np.einsum("ij,ij->i", vectors, vectors)
            place = int(np.argmax(squares))
            self.note(float(squares[place]), first + place)

    def note(self, square: float, record: int) -> None:
        """Take in the largest of some squared values, and the record where it is."""
        # Not `>`: a NaN must not pass for small, nor be forgotten.
        if not square <= self._square and self._square < math.inf:
            self._square, self._record = square, record

    def peak(self, limit: float, period: float, power: int) -> Peak:
        return Peak(math.sqrt(self._square) / period**power, self._record * period, limit)


def _peaks(
    row: list[_Largest], limits: tuple[float, ...], period: float, power: int
) -> tuple[Peak, ...]:
    return tuple(one.peak(limit, period, power) for one, limit in zip(row, limits, strict=False))
