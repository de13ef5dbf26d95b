"""The certificate of a motion: what a device sees of it, differentiated as the device does it.

A device knows setpoints, not derivatives.  It takes the rotation vector from one setpoint to the
next over a period for the velocity, the change of that for the acceleration and the change of that
for the jerk, so this is what is held against the limits, on the very records that are sent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from orientd.driver import Figure
from orientd.planner.brake import (
    FASTEST_BRAKE_RATE,
    LAW,
    axis_brake_rate,
    brake_rate,
    linear_brake_rate,
)
from orientd.planner.fast import kernels
from orientd.planner.limit_table import limit_table
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
"""Gives orientations ``(m, 4)`` and positions ``(m, 3)`` of *m* records from an index on; positions
that are all the same come as one, ``(1, 3)``."""


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

    def note(self, found: Extremes, index: int) -> None:
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
        setpoints: gives the records from an index on.
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
        # A device that keeps its place is the ordinary case.
        is_still = len(p) == 1 and bool((p_tail == p).all())
        q = _padded(q_tail, q, size, held)
        p = p if is_still else _padded(p_tail, p, size, held)
        index = first - len(q_tail)
        q_tail = q[-HISTORY:]
        p_tail = np.repeat(p[-1:], len(q_tail), axis=0) if is_still else p[-HISTORY:]

        # In units of rad a period: the powers of the period come in once, at the end.
        # What ends before the first record is the past, which nothing can change.
        past = 1 if first == 0 and before is not None else 0
        found = extremes(
            q,
            past=past,
            with_axes=limits.has_axes,
            period=period,
            start=period * (index + HISTORY),
            rough=rough,
            brake_limits=brake_limits,
        )
        for order, largest in enumerate((turn, bend, twist)):
            largest.note(*found.peak(order, 0, index))
        components.note(found, index)
        if found.rate < slowest:
            slowest, slowest_index = found.rate, index + HISTORY + found.rate_place
        if is_still:
            continue
        v = np.diff(p, axis=0)
        a = np.diff(v, axis=0)
        move.see(_squares(v[2 * past :]), index + 1 + 2 * past)
        push.see(_squares(a[past:]), index + 2 + past)
        if brake_limits is not None:
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


def _padded(before: Floats, rows: Floats, size: int, held: int) -> Floats:
    """Return *size* rows with those before them and the last one held after them.

    Components come first in memory, as from the curves.
    """
    begin, end = len(before), len(before) + size
    padded: Floats = np.empty((rows.shape[1], end + held)).T
    padded[:begin], padded[begin:end], padded[end:] = before, rows, rows[-1:]
    return padded


@dataclass(frozen=True, slots=True)
class Extremes:
    """What a certificate takes of some setpoints.

    Attributes:
        largest: squares of the largest backward differences, in units of rad a period: of the
            norm, and of the components where they are wanted, shape ``(3, 4)``.
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
        q: setpoints, shape ``(n, 4)``.
        past: how many accelerations, and twice as many velocities, do not count as largest.
        with_axes: whether the largest components are wanted, too.
        period: from one setpoint to the next, s.
        start: path time of the fourth setpoint, s.
        rough: where the brake rate must expect more between the records than on them.
        brake_limits: limits for the brake rate; ``None`` leaves it out.
    """
    part = _SMOOTH if rough is None else _reach(rough, period)
    compiled = kernels().extremes
    if compiled is not None:
        largest: Floats = np.zeros((3, 4))
        places = np.zeros((3, 4), dtype=np.intp)
        limits = None if brake_limits is None else limit_table(brake_limits)
        rate, place = compiled(
            q,
            past,
            with_axes or (brake_limits is not None and brake_limits.has_axes),
            period,
            start,
            part,
            limits is not None,
            _NO_LIMITS if limits is None else limits[1:],
            *LAW,
            largest,
            places,
        )
        return Extremes(largest.tolist(), places.tolist(), rate, place)
    omega, alpha, jerk = rates = differences(q)
    squares = [_squares(rate) for rate in rates]
    found = Extremes([[0.0] * 4 for _ in ANGULAR], [[0] * 4 for _ in ANGULAR])
    for order, first in enumerate((2 * past, past, 0)):
        columns = [squares[order], *(rates[order].T ** 2 if with_axes else ())]
        for column, values in enumerate(columns):
            if len(values) > first:
                place = first + int(np.argmax(values[first:]))
                found.largest[order][column] = float(values[place])
                found.places[order][column] = place
    if brake_limits is None or not len(jerk):
        return found
    times = start + period * np.arange(len(jerk))
    is_rough = (times >= part[0]) & (times < part[1])
    bends, twists = (np.where(is_rough, scale, 1.0) for scale in part[2:])
    velocity = omega[2:] / period
    acceleration = bends[:, None] * alpha[1:] / period**2
    jerk = twists[:, None] * jerk / period**3
    slowest = brake_rate(velocity, acceleration, np.sqrt(_squares(jerk)), brake_limits)
    if brake_limits.has_axes:
        slowest = min(slowest, axis_brake_rate(velocity, acceleration, jerk, brake_limits))
    return replace(found, rate=slowest[0], rate_place=slowest[1])


_SMOOTH = np.array([np.inf, -np.inf, 1.0, 1.0])
_NO_LIMITS = np.full((2, 4), np.inf)


def _reach(rough: Rough, period: float) -> Floats:
    """Return from when to when differences see a rough part, and how much larger they may be."""
    return np.array([rough.begin, rough.end + HISTORY * period, *OFF_GRID[rough.continuity]])


def differences(q: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the first three backward differences of orientations, in units of rad a period.

    Args:
        q: setpoints, shape ``(n, 4)``.

    Returns:
        The rotation vectors from one setpoint to the next, the change of these and the change of
        that, shapes ``(n - 1, 3)`` to ``(n - 3, 3)``.
    """
    omega = log(multiply(conjugate(q[:-1]), q[1:]))
    alpha = np.diff(omega, axis=0)
    return omega, alpha, np.diff(alpha, axis=0)


def _squares(vectors: Floats) -> Floats:
    squares: Floats = np.einsum("ij,ij->i", vectors, vectors)
    return squares
