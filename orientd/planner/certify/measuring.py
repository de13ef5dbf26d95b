r"""Bounds of backward differences, which are all that a device knows of setpoints.

A device receives setpoints, not derivatives.  It takes the rotation vector between two setpoints
over a period as the velocity.  Differences of that are the acceleration and the jerk.  The
certificate therefore checks these differences.  They count on the records, which the servo sends
while a motion runs as planned.  They also count on the path between them
(:mod:`orientd.servo.path.segment`), which it sends after a pause, a stop or at another speed.

A certificate's bounds of velocity, acceleration and jerk, of the norm and of the components, are
*proven* for setpoints a constant share of a period apart: for every phase relative to the records
and every rate in [0, 1].  They are at most :math:`3 \cdot 10^{-4}` above a value that occurs.  The
bound of a component far below the norm may be looser if refining it takes too long.  First, second
and third differences are averages of velocity, acceleration and jerk, plus a bounded term because
rotations do not commute (``kernels/c/segments.c``, ``enclosure.c``).  At the rate 1 they are
polynomials of the phase plus a bounded remainder, and lie in the hull of their Bernstein
coefficients.  The bounds hold in exact arithmetic; rounding adds some 1e-15 rad.

These are *sampled* only, at the records and three phases between them, at most 0.36 of a period
apart:

- periods in which the path turns by more than 0.5 rad, which the certificate notes;
- the jerk that the brake rate uses, and the product of the vectors of velocity and acceleration;
- all values of a plan without a certificate.

The turn of the tool is one *channel* of the certificate.  The position is another, and so is each
group of up to three axes.  Between two records these are cubics, which commute: the same bounds
hold for them without what rotations add.

Differences that reach back to records without rates are checked on the records alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from orientd import kernels
from orientd.driver import AxisLimits, Joints
from orientd.errors import LimitKind, PlanError
from orientd.mechanism.figure import Figure
from orientd.mechanism.joint_path import KINDS, AxisPeak
from orientd.model.limits import ANGULAR, Limits
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, law
from orientd.planner.certify.certificate import Peak
from orientd.planner.facts import HISTORY
from orientd.planner.path import Path
from orientd.rotation import Floats

STATE = 16
"""Numbers of a setpoint: orientation, angular velocity and acceleration, position, velocity."""

_TURN = 10  # the first of them, which are about the turn
_EXTREMES = 40  # numbers of ``extremes_t`` in ``kernels/c/certify.h``
_MOST_AXES = 3  # that one channel holds
_NO_PATH = np.empty(0), np.empty((0, 0))


class AxisRecords(NamedTuple):
    """The axes of a device at the records of a path.

    Attributes:
        joints: angles, rad, shape ``(n, axes)``; the device stays at the last.
        rates: velocities, rad/s, same shape.
        earlier: angles at the three records before, oldest first, rad, shape ``(3, axes)``.
        limits: of every axis.
        figures: about the way that the axes take.
    """

    joints: Floats
    rates: Floats
    earlier: Floats
    limits: Sequence[AxisLimits]
    figures: tuple[Figure, ...] = ()

    @property
    def first(self) -> Joints:
        """Angles at the first record, rad."""
        return tuple(self.joints[0].tolist())

    @property
    def last(self) -> Joints:
        """Angles at the last record, rad."""
        return tuple(self.joints[-1].tolist())


@dataclass(frozen=True, slots=True)
class Peaks:
    """Bounds of the rates over records, by backward differences.

    Attributes:
        velocity: angular, rad/s.
        acceleration: angular, rad/s^2.
        jerk: angular, rad/s^3.
        linear_velocity: of the position, m/s.
        linear_acceleration: of the position, m/s^2.
        brake_rate: largest safe brake rate, 1/s.
        brake_time: path time of the record that sets it, s.
        usual_stop_time: duration of the longest stop, s, if it brakes as hard as the limits permit
            on a straight path: a double integrator with bounded jerk.
        axis_velocity: components of the angular velocity in the body frame, rad/s.  This and the
            next two are empty if no single component is limited.
        axis_acceleration: of the angular acceleration, rad/s^2.
        axis_jerk: of the angular jerk, rad/s^3.
        axes: of the axes of the device, one by one: velocity, acceleration and, if it is limited,
            jerk.
        unproven: number of places without a proof, with sampled peaks.
    """

    velocity: Peak
    acceleration: Peak
    jerk: Peak
    linear_velocity: Peak
    linear_acceleration: Peak
    brake_rate: float
    brake_time: float
    usual_stop_time: float = 0.0
    axis_velocity: tuple[Peak, ...] = ()
    axis_acceleration: tuple[Peak, ...] = ()
    axis_jerk: tuple[Peak, ...] = ()
    axes: tuple[AxisPeak, ...] = ()
    unproven: int = 0

    @property
    def turns(self) -> tuple[tuple[Peak, ...], ...]:
        """Peaks of velocity, acceleration and jerk, of the norm and of the axes."""
        return (
            (self.velocity, *self.axis_velocity),
            (self.acceleration, *self.axis_acceleration),
            (self.jerk, *self.axis_jerk),
        )

    @property
    def planned(self) -> list[float]:
        """The largest shares of the limits of velocity, acceleration and jerk on the records."""
        return [max(peak.planned_ratio for peak in peaks) for peaks in self.turns]

    @property
    def drawn(self) -> list[float]:
        """The largest shares of the three limits between the records."""
        return [max(peak.ratio for peak in peaks) for peaks in self.turns]


# A plan needs the same few again and again.
@lru_cache(maxsize=64)
def limit_table(limits: Limits) -> Floats:
    """Return limits of velocity, acceleration and jerk: of the norm and of the components.

    Returns:
        Read-only, shape ``(3, 4)``, in rad and s.
    """
    table: Floats = np.array([(getattr(limits, name), *limits.axes(name)) for name in ANGULAR])
    table.setflags(write=False)
    return table


class _Channel(NamedTuple):
    """Setpoints of one channel, as the kernel takes them; see ``kernels/c/certify.h``."""

    is_turn: bool
    breaks: Floats
    pieces: Floats
    rows: Floats
    before: Floats


@dataclass(slots=True)
class _Measure:
    """Parameters that all channels share, and the least brake rate so far.

    Attributes:
        count: number of records.
        held: number of setpoints after them.
        period: s.
        tolerance: as for :func:`measure`.
        rate: the least brake rate, 1/s.
        record: the record that sets it.
        stop_time: of the longest usual stop, s.
        unproven: number of places without a proof.
    """

    count: int
    held: int
    period: float
    tolerance: float
    rate: float = FASTEST_BRAKE_RATE
    record: float = 0.0
    stop_time: float = 0.0
    unproven: int = 0

    def peaks(
        self, channel: _Channel, limits: Floats, columns: range, rests: tuple[bool, bool]
    ) -> dict[tuple[int, int], Peak]:
        """Return the bounds of a channel by order and column.

        Args:
            channel: its setpoints.
            limits: of each order, of the norm and the components, shape ``(orders, 4)``.
            columns: that count.
            rests: whether it begins and ends at rest.
        """
        found: Floats = np.empty(_EXTREMES)
        kernels.certify(
            *channel, self.count, self.held, *rests, self.period,
            limits, columns.start, columns.stop, self.tolerance, *law(self.rate), found,
        )  # fmt: skip
        numbers = found.tolist()
        rate, record, stop_time, unproven = numbers[36:]
        if rate < self.rate:
            self.rate, self.record = rate, record
        self.stop_time = max(self.stop_time, stop_time)
        self.unproven += int(unproven)
        unit, peaks = 1.0, {}
        for order, most in enumerate(limits.tolist()):
            unit *= self.period
            for column in columns:
                slot = 4 * order + column
                peaks[order, column] = Peak(
                    value=math.sqrt(numbers[slot]) / unit,
                    time=numbers[24 + slot] * self.period,
                    limit=most[column],
                    on_records=math.sqrt(numbers[12 + slot]) / unit,
                )
        return peaks


def measure(
    path: Path | Floats,
    count: int,
    period: float,
    limits: Limits,
    *,
    before: tuple[Floats, Floats] | None,
    rests: tuple[bool, bool] | None = None,
    tolerance: float = 0.0,
    axes: AxisRecords | None = None,
) -> Peaks:
    """Return bounds of the backward differences over the records 0 to *count* - 1.

    Args:
        path: a path that gives the records at multiples of the period; or records, shape ``(n,
            16)``: orientations, angular velocities and accelerations, positions and velocities;
            rates are NaN if unknown.
        count: number of records.
        period: time between them, s.
        limits: the limits of the peaks.
        before: the three setpoints before the first, ``(3, 4)`` and ``(3, 3)``; ``None`` uses
            differences inside the records only.
        rests: whether the path begins at rest and the device stays at the last record; ``None``
            takes it from the path.
        tolerance: factor of the limits up to which the path may brake, for a certificate.  With 0
            there is no certificate, and differences are sampled.
        axes: of the device, at the same records.

    Raises:
        PlanError: an angle or a velocity of an axis is not a number.
    """
    if rests is None:
        rests = (path.begins_at_rest, True) if isinstance(path, Path) else (False, True)
    how = _Measure(count, HISTORY if rests[1] else 0, period, tolerance)
    table = limit_table(limits)
    columns = range(4 if limits.has_axes else 1)
    turns = how.peaks(_turn_of(path, before), table, columns, rests)
    linear = np.zeros((2, 4))
    linear[:, 0] = limits.linear_velocity, limits.linear_acceleration
    position = _position_of(path, before)
    if position is None:
        moves = [Peak(0.0, 0.0, limit, 0.0) for limit in linear[:, 0].tolist()]
    else:
        moves = list(how.peaks(position, linear, range(1), (False, rests[1])).values())
        how.stop_time = max(how.stop_time, moves[0].value / moves[1].limit)
    of_axes = tuple(_axis_peaks(how, axes)) if axes is not None else ()
    (velocity, *spins), (acceleration, *bends), (jerk, *twists) = (
        [turns[order, column] for column in columns] for order in range(3)
    )
    return Peaks(
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        linear_velocity=moves[0],
        linear_acceleration=moves[1],
        brake_rate=how.rate,
        brake_time=how.record * period,
        usual_stop_time=how.stop_time,
        axis_velocity=tuple(spins),
        axis_acceleration=tuple(bends),
        axis_jerk=tuple(twists),
        axes=of_axes,
        unproven=how.unproven,
    )


def _turn_of(path: Path | Floats, before: tuple[Floats, Floats] | None) -> _Channel:
    earlier = np.zeros((0 if before is None else HISTORY, _TURN))
    if before is not None:
        earlier[:, :4] = before[0]
        # The rates are known if the device held there.
        earlier[:, 4:] = 0.0 if (before[0] == before[0][:1]).all() else np.nan
    if isinstance(path, Path):
        trajectory = path.trajectory
        none = np.empty((0, _TURN))
        return _Channel(True, trajectory.breaks, trajectory.pieces, none, earlier)
    return _Channel(True, *_NO_PATH, np.ascontiguousarray(path[:, :_TURN]), earlier)


def _position_of(path: Path | Floats, before: tuple[Floats, Floats] | None) -> _Channel | None:
    """Return the position; ``None`` if it stays."""
    places = np.empty((0, 3)) if before is None else before[1]
    if isinstance(path, Path):
        positions = path.positions
        if positions.is_held and (places == positions.first).all():
            return None
        if positions.is_held:
            # A kernel takes a position that stays as one quintic, whose velocity is zero.
            breaks, pieces = np.array([0.0, path.duration]), np.zeros((1, 18))
            pieces[0, :3] = positions.first
        else:
            breaks, pieces = positions.breaks, positions.coefficients.reshape(-1, 18)
        return _Channel(False, breaks, pieces, np.empty((0, 6)), _places_before(places))
    rows = np.ascontiguousarray(path[:, _TURN:])
    return _Channel(False, *_NO_PATH, rows, _places_before(places))


def _places_before(places: Floats) -> Floats:
    """Return positions before a path with their velocities, known if the device held there."""
    velocity = 0.0 if (places == places[:1]).all() else np.nan
    return np.concatenate([places, np.full(places.shape, velocity)], axis=1)


def _axis_peaks(how: _Measure, axes: AxisRecords) -> Iterator[AxisPeak]:
    """Yield the peaks of the axes, up to three of which share a channel.

    Raises:
        PlanError: an angle or a velocity of an axis is not a number.
    """
    is_number = np.isfinite(axes.joints) & np.isfinite(axes.rates)
    if not is_number.all():
        record, place = np.argwhere(~is_number)[0].tolist()
        name, time = axes.limits[place].name, record * how.period
        raise PlanError(f"the angle or velocity of {name} is not a number at {time:.4f} s")
    past = _rates_before(axes) / how.period
    for first in range(0, len(axes.limits), _MOST_AXES):
        of = axes.limits[first : first + _MOST_AXES]
        columns = slice(first, first + len(of))
        orders = 3 if any(math.isfinite(axis.jerk) for axis in of) else 2
        table: Floats = np.full((orders, 4), np.inf)
        for column, axis in enumerate(of, 1):
            table[:, column] = (axis.velocity, axis.acceleration, axis.jerk)[:orders]
        rows, before = np.zeros((how.count, 6)), np.zeros((HISTORY, 6))
        for at, values, rates in (
            (rows, axes.joints, axes.rates),
            (before, axes.earlier, past),
        ):
            at[:, : len(of)], at[:, 3 : 3 + len(of)] = values[:, columns], rates[:, columns]
        before[np.isnan(before[:, 3]), 3:] = np.nan
        channel = _Channel(False, *_NO_PATH, rows, before)
        peaks = how.peaks(channel, table, range(1, 1 + len(of)), (False, True))
        for column, axis in enumerate(of, 1):
            for order, kind in enumerate(KINDS[:orders]):
                if kind is not LimitKind.JERK or math.isfinite(axis.jerk):
                    peak = peaks[order, column]
                    yield AxisPeak(kind, axis, peak.value, peak.limit, peak.time)


def _rates_before(axes: AxisRecords) -> Floats:
    """Return the motion per period at the three records before a path; not a number if unknown.

    It is zero at rest, and otherwise that of differences.
    """
    a, b, c = axes.earlier
    if (a == b).all() and (b == c).all():
        return np.zeros(axes.earlier.shape)
    d, e = axes.joints[:2] if len(axes.joints) > 1 else axes.joints[[0, 0]]
    at_b, at_c = (6.0 * c - 2.0 * a - 3.0 * b - d) / 6.0, (8.0 * (d - b) - (e - a)) / 12.0
    return np.stack([np.full(len(a), np.nan), at_b, at_c])
