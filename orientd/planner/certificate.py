"""The certificate of a motion: what a device sees of it, differentiated as the device does it.

A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to the
next over a period for the velocity, the change of that for the acceleration and the change of that
for the jerk, so this is what is held against the limits, on the very records that are sent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orientd.driver import Figure
from orientd.planner.brake import (
    FASTEST_BRAKE_RATE,
    axis_brake_rate,
    brake_rate,
    linear_brake_rate,
)
from orientd.planner.fast import kernels
from orientd.planner.limits import ANGULAR, AXES, Limits
from orientd.rotation import Floats, conjugate, log, multiply

CHUNK = 8192
"""Records looked at in one go, so that a long motion needs no more memory than a short one."""

HISTORY = 3
"""Setpoints before the first that a third difference reaches back to."""

OFF_GRID = {0: (2.0, 2.0), 1: (1.0, 1.5), 2: (1.0, 1.0)}
"""By how much acceleration and jerk can be larger between the records of a curve, by continuity.

A stop on the path leaves the grid of records.  A step of the acceleration then falls elsewhere
between two setpoints, and its share in the third difference, the quadratic B-spline at that place,
varies from 1/2 to 3/4; that of a step of the velocity in second and third varies from 1/2 to 1.
"""

Setpoints = Callable[[int, int], tuple[Floats, Floats]]


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


@dataclass(frozen=True, slots=True)
class Certificate:
    """What a motion was checked for; what has none is not streamed.

    Attributes:
        rate_hz: the device's cycles a second, at which all this holds.
        duration: from hold to hold, s.
        lead_in: the part of it before the first keyframe, s.
        lead_out: the part of it after the last keyframe, s.
        peak_velocity: angular, rad/s.
        peak_acceleration: angular, rad/s^2.
        peak_jerk: angular, rad/s^3.
        peak_linear_velocity: m/s.
        peak_linear_acceleration: m/s^2.
        start_velocity_error: between the velocity asked for at the first keyframe and the
            motion's, rad/s; zero where none was asked for.
        end_velocity_error: the same at the last keyframe, rad/s.
        keyframe_error: largest angle between a keyframe and the motion at its time, rad; not small
            for methods that do not interpolate.
        brake_rate: how fast the servo may change speed on the path, 1/s.
        stop_time: how long a stop from full speed takes then, s.
        figures: what is certified beyond that: of the body's axes where they have limits of
            their own, and what the device's driver adds, of its own axes for example.
        notes: what the driver has to say of the motion, a line each.
    """

    rate_hz: float
    duration: float
    lead_in: float
    lead_out: float
    peak_velocity: Peak
    peak_acceleration: Peak
    peak_jerk: Peak
    peak_linear_velocity: Peak
    peak_linear_acceleration: Peak
    start_velocity_error: float
    end_velocity_error: float
    keyframe_error: float
    brake_rate: float
    stop_time: float
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()


class _Largest:
    """A running maximum with the index where it was reached."""

    def __init__(self, power: int, period: float) -> None:
        self._unit = period**power
        self._period = period
        self._square = 0.0
        self._index = 0

    def see(self, squares: Floats, first: int) -> None:
        """Take in squared values of the records from *first* on, in units of ``period**-power``."""
        if not len(squares):
            return
        place = int(np.argmax(squares))
        self.note(float(squares[place]), first + place)

    def note(self, square: float, index: int) -> None:
        """Take in the largest of some squared values, and the record where it is."""
        # Not `>`: a NaN must not pass for small.
        if not square <= self._square:
            self._square, self._index = square, index

    def peak(self, limit: float) -> Peak:
        return Peak(float(np.sqrt(self._square)) / self._unit, self._index * self._period, limit)


class _Components:
    """The largest of each component of the three angular rates, where one is limited."""

    def __init__(self, period: float, limits: Limits) -> None:
        self._limits = limits
        self._largest = [
            [_Largest(power, period) for _ in AXES] if limits.has_axes else []
            for power in range(1, len(ANGULAR) + 1)
        ]

    def note(self, found: Differences, index: int) -> None:
        """Take in the largest of some differences, the first setpoint of which is *index*."""
        for order, row in enumerate(self._largest):
            for axis, largest in enumerate(row):
                largest.note(*found.peak(order, 1 + axis, index))

    def peaks(self) -> dict[str, tuple[Peak, ...]]:
        return {
            f"axis_{name}": tuple(
                largest.peak(limit)
                for largest, limit in zip(row, self._limits.axes(name), strict=False)
            )
            for name, row in zip(ANGULAR, self._largest, strict=True)
        }


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


def _off_grid(rough: Rough, first: float, period: float, count: int) -> tuple[Floats, Floats]:
    """Return by how much to scale accelerations and jerks of records from time *first* on."""
    bends, twists = np.ones(count), np.ones(count)
    times = first + period * np.arange(count)
    is_rough = (times >= rough.begin) & (times < rough.end + HISTORY * period)
    bends[is_rough], twists[is_rough] = OFF_GRID[rough.continuity]
    return bends, twists


def measure(
    setpoints: Setpoints,
    count: int,
    period: float,
    limits: Limits,
    *,
    before: tuple[Floats, Floats] | None,
    holds_after: bool,
    brake_limits: Limits | None = None,
    rough: Rough | None = None,
) -> Peaks:
    """Return the largest backward differences over the records 0 to *count* - 1.

    Args:
        setpoints: gives orientations ``(m, 4)`` and positions ``(m, 3)`` of the records from an
            index on.
        count: number of records.
        period: time between them, s.
        limits: what the peaks are held against.
        before: the three setpoints before the first, ``(3, 4)`` and ``(3, 3)``; ``None`` looks at
            differences inside the records only.
        holds_after: whether the device stays where the last record is.
        brake_limits: limits for the brake rate; ``None`` leaves the brake rate out.
        rough: where the brake rate must expect more between the records than on them.
    """
    turn, bend, twist = (_Largest(power, period) for power in (1, 2, 3))
    move, push = (_Largest(power, period) for power in (1, 2))
    components = _Components(period, limits)
    slowest, slowest_index = FASTEST_BRAKE_RATE, 0
    q_tail, p_tail = before if before is not None else (np.empty((0, 4)), np.empty((0, 3)))
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        q, p = setpoints(first, size)
        held = HISTORY if holds_after and first + size == count else 0
        q = np.concatenate([q_tail, q, *(q[-1:],) * held])
        p = np.concatenate([p_tail, p, *(p[-1:],) * held])
        index = first - len(q_tail)
        q_tail, p_tail = q[-HISTORY:].copy(), p[-HISTORY:].copy()

        # In units of rad a period: the powers of the period come in once, at the end.
        # What ends before the first record is the past, which nothing can change.
        past = 1 if first == 0 and before is not None else 0
        found = differences(q, past=past, with_axes=limits.has_axes)
        (omega, alpha, jerk), squares = found.rates, found.squares
        for order, largest in enumerate((turn, bend, twist)):
            largest.note(*found.peak(order, 0, index))
        components.note(found, index)
        # A device that keeps its place is the ordinary case; see whether it moves at all.
        is_still = bool((p == p[0]).all())
        if not is_still:
            v = np.diff(p, axis=0)
            a = np.diff(v, axis=0)
            move.see(_squares(v[2 * past :]), index + 1 + 2 * past)
            push.see(_squares(a[past:]), index + 2 + past)
        if brake_limits is None:
            continue
        velocity, acceleration = omega[2:] / period, alpha[1:] / period**2
        sizes = np.sqrt(squares[2]) / period**3
        if rough is not None:
            bends, twists = _off_grid(rough, period * (index + 3), period, len(jerk))
            acceleration *= bends[:, None]
            jerk, sizes = jerk * twists[:, None], sizes * twists
        rate, place = brake_rate(velocity, acceleration, sizes, brake_limits)
        if rate < slowest:
            slowest, slowest_index = rate, index + 3 + place
        if brake_limits.has_axes:
            rate, place = axis_brake_rate(velocity, acceleration, jerk / period**3, brake_limits)
            if rate < slowest:
                slowest, slowest_index = rate, index + 3 + place
        if not is_still:
            rate, place = linear_brake_rate(
                v[1 + past :] / period, a[past:] / period**2, brake_limits
            )
            if rate < slowest:
                slowest, slowest_index = rate, index + 2 + past + place
    return Peaks(
        turn.peak(limits.velocity),
        bend.peak(limits.acceleration),
        twist.peak(limits.jerk),
        move.peak(limits.linear_velocity),
        push.peak(limits.linear_acceleration),
        slowest,
        slowest_index * period,
        **components.peaks(),
    )


@dataclass(frozen=True, slots=True)
class Differences:
    """Backward differences of orientations, in units of rad a period.

    Attributes:
        rates: the rotation vectors from one setpoint to the next, the change of these and the
            change of that, shapes ``(n - 1, 3)`` to ``(n - 3, 3)``.
        squares: the squares of their norms.
        largest: the largest of these squares, and of those of the components where they are wanted,
            shape ``(3, 4)``.
        places: where these are, shape ``(3, 4)``.
    """

    rates: list[Floats]
    squares: list[Floats]
    largest: list[list[float]]
    places: list[list[int]]

    def peak(self, order: int, column: int, first: int) -> tuple[float, int]:
        """Return the largest square, and its record where that of the first setpoint is *first*."""
        return self.largest[order][column], first + order + 1 + self.places[order][column]


def differences(q: Floats, *, past: int = 0, with_axes: bool = False) -> Differences:
    """Return the first three backward differences of orientations.

    Args:
        q: setpoints, shape ``(n, 4)``.
        past: how many accelerations, and twice as many velocities, do not count as largest.
        with_axes: whether the largest components are wanted, too.
    """
    largest: Floats = np.zeros((3, 4))
    places = np.zeros((3, 4), dtype=np.intp)
    compiled = kernels().differences
    if compiled is not None:
        counts = [max(len(q) - order, 0) for order in (1, 2, 3)]
        rates = [np.empty((count, 3)) for count in counts]
        norms: Floats = np.empty((3, len(q)))
        omega, alpha, jerk = rates
        compiled(q, past, with_axes, omega, alpha, jerk, norms, largest, places)
        squares = [row[:count] for row, count in zip(norms, counts, strict=True)]
        return Differences(rates, squares, largest.tolist(), places.tolist())
    omega = log(multiply(conjugate(q[:-1]), q[1:]))
    alpha = np.diff(omega, axis=0)
    rates = [omega, alpha, np.diff(alpha, axis=0)]
    squares = [_squares(rate) for rate in rates]
    for order, first in enumerate((2 * past, past, 0)):
        columns = [squares[order], *(rates[order].T ** 2 if with_axes else ())]
        for column, values in enumerate(columns):
            if len(values) > first:
                place = first + int(np.argmax(values[first:]))
                largest[order, column], places[order, column] = values[place], place
    return Differences(rates, squares, largest.tolist(), places.tolist())


def _squares(vectors: Floats) -> Floats:
    squares: Floats = np.einsum("ij,ij->i", vectors, vectors)
    return squares
