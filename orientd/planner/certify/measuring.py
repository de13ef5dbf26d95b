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
- the angular values that set the brake rate;
- all angular values of a plan without a certificate.

Between two records the position is a cubic, so at the rate 1 its differences are cubics of the
phase.  Their bounds, and the values of the position that set the brake rate, are those of their
Bernstein coefficients.  At a lower rate the differences are not bounded again.  They fall with the
rate and its square, unless the acceleration reverses twice within two periods.

Differences that reach back to records without rates are checked on the records alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from orientd import kernels
from orientd.model.limits import ANGULAR, Limits
from orientd.planner.certify.brake import LAW
from orientd.planner.certify.certificate import Peak
from orientd.planner.facts import HISTORY
from orientd.planner.path import Path
from orientd.rotation import Floats

STATE = 16
"""Numbers of a setpoint: orientation, angular velocity and acceleration, position, velocity."""

_EXTREMES = 46  # numbers of ``extremes_t`` in ``kernels/c/certify.h``
_NO_ROWS: Floats = np.empty((0, STATE))
_NO_PATH = np.empty(0), np.empty((0, 0))
_STILL = np.empty(0), np.empty((0, 18))


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


def measure(
    path: Path | Floats,
    count: int,
    period: float,
    limits: Limits,
    *,
    before: tuple[Floats, Floats] | None,
    rests: tuple[bool, bool] | None = None,
    tolerance: float = 0.0,
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
    """
    rows, orientations, moves, place = _NO_ROWS, _NO_PATH, _STILL, np.zeros(3)
    if isinstance(path, Path):
        trajectory, positions = path.trajectory, path.positions
        orientations, place = (trajectory.breaks, trajectory.pieces), positions.first
        if not positions.is_held:
            moves = positions.breaks, positions.coefficients.reshape(-1, 18)
        rests = (path.begins_at_rest, True) if rests is None else rests
    else:
        rows, rests = path, rests or (False, True)
    rows_before = _NO_ROWS if before is None else _states(*before)
    linear = np.array([limits.linear_velocity, limits.linear_acceleration])
    found: Floats = np.empty(_EXTREMES)
    kernels.certify(
        *orientations, *moves, np.ascontiguousarray(place), rows, rows_before, count,
        HISTORY if rests[1] else 0, rests[0], rests[1], period, limit_table(limits), linear,
        tolerance, *LAW, found,
    )  # fmt: skip
    return _named(found.tolist(), period, limits)


def _states(q: Floats, positions: Floats) -> Floats:
    """Return setpoints before a path, with rates if the device held there."""
    states: Floats = np.zeros((len(q), STATE))
    states[:, :4], states[:, 10:13] = q, positions
    if not (q == q[:1]).all():
        states[:, 4:10] = np.nan
    if not (positions == positions[:1]).all():
        states[:, 13:] = np.nan
    return states


def _named(found: list[float], period: float, limits: Limits) -> Peaks:
    """Return the kernel's results by name and in SI units."""
    units = period, period**2, period**3

    def turns(order: int) -> list[Peak]:
        name, unit = ANGULAR[order], units[order]
        most = [getattr(limits, name), *(limits.axes(name) if limits.has_axes else ())]
        return [
            Peak(
                value=math.sqrt(found[slot]) / unit,
                time=found[24 + slot] * period,
                limit=limit,
                on_records=math.sqrt(found[12 + slot]) / unit,
            )
            for slot, limit in enumerate(most, 4 * order)
        ]

    def linear(order: int, limit: float) -> Peak:
        value, on_records = (math.sqrt(found[k + order]) / units[order] for k in (36, 44))
        return Peak(value, found[38 + order] * period, limit, on_records)

    (velocity, *spins), (acceleration, *bends), (jerk, *twists) = map(turns, range(3))
    rate, record, stop_time, unproven = found[40:44]
    return Peaks(
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        linear_velocity=linear(0, limits.linear_velocity),
        linear_acceleration=linear(1, limits.linear_acceleration),
        brake_rate=rate,
        brake_time=record * period,
        usual_stop_time=stop_time,
        axis_velocity=tuple(spins),
        axis_acceleration=tuple(bends),
        axis_jerk=tuple(twists),
        unproven=int(unproven),
    )
