r"""How fast a path that is known at its records may be slowed down, for joints and for the tool.

Between two records every joint is the cubic of Hermite that the servo draws
(:mod:`orientd.servo.path.segment`), and so is the rotation vector of the tool.  The device takes
differences of setpoints.  At the rates :math:`\sigma_1, \sigma_2` of two cycles, whose mean is
:math:`\sigma`, the second one is

.. math::
    \Delta^2\theta = (\sigma_2 - \sigma_1)\, \bar v + \sigma^2 \bar a

with means :math:`\bar v, \bar a` of the cubics' velocity and acceleration, over a cycle and over
two.  So it is the inequality of :mod:`orientd.planner.certify.brake` in one dimension.  The mean
:math:`\bar a` at a rate is the second difference of setpoints with that rate, whatever their phase
against the records.

These are taken at every eighth of a period, for every eighth of a rate from 1 down to a half.  In
between a difference is larger by an eighth of its own second difference by place, and by what the
cubics' acceleration allows by rate.  Below half of the full rate that acceleration itself bounds
the mean: a spike of it, as cubics have beside a step, counts a quarter there.

The tool's differences count up to 95 % of the limit, as in ``brake.c``: at full speed the path is
certified, and a share of the limit is left to brake with.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import LimitError, LimitKind
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, brake_rate
from orientd.rotation import Floats, conjugate, log, multiply
from orientd.tolerances import GUARD_TOLERANCE

PARTS = 8
"""Places in a period, and rates below the full one, at which differences are taken."""

_BETWEEN = 2.0 / (8.0 * PARTS**2)
"""Of the cubics' acceleration: how much larger a difference is between two rates than at them."""

_SHARES = 8.0 * np.geomspace(1e-5, 0.125, 24)
"""Of the way from the full rate to the next one, at which a change of it is looked at."""
_CHANGES = np.sqrt(_SHARES)
"""How fast the rate may change there, by the brake rate."""
_MARGIN = 0.99
"""For what lies between these."""

_LOCAL = 0.95
"""Share of the tool's limit up to which its acceleration counts, as in ``brake.c``."""

_UNITS = {
    LimitKind.VELOCITY: "rad/s",
    LimitKind.ACCELERATION: "rad/s^2",
    LimitKind.JERK: "rad/s^3",
}


class Brake(NamedTuple):
    """How fast a path may be slowed down.

    Attributes:
        rate: largest safe brake rate, 1/s.
        record: that sets it.
    """

    rate: float
    record: int


def joint_brake(
    joints: Floats,
    rates: Floats,
    earlier: Floats,
    period: float,
    axes: Sequence[AxisLimits],
) -> Brake:
    """Return how fast a path may be slowed down for the joints' sake.

    Args:
        joints: at the records of the path, rad, shape ``(n, joints)``; the device stays at the
            last.
        rates: their velocities there, rad/s, of the same shape.
        earlier: joints at the three records before it, the oldest first, rad, shape ``(3,
            joints)``.
        period: from one record to the next, s.
        axes: limits of every joint.

    Raises:
        LimitError: a joint breaks a limit at some phase of the setpoints against the records.
    """
    found = Brake(FASTEST_BRAKE_RATE, 0)
    for place, axis in enumerate(axes):
        way = np.concatenate([earlier[-2:, place], joints[:, place], joints[-1:, place]])
        slope = np.concatenate(
            [_past(earlier[:, place], joints[:2, place]), rates[:, place] * period, [0.0]]
        )
        one = _JointRide(way, slope)
        one.check(axis, period)
        rate, record = one.brake_rate(axis, period)
        if rate < found.rate:
            found = Brake(rate, max(record - 2, 0))
    return found


def tool_brake(q: Floats, period: float, limits: Sequence[float]) -> Brake:
    """Return how fast a path may be slowed down for the sake of the tool's acceleration.

    Args:
        q: orientations at every eighth of a period, from the first record to the last, where the
            device stays, shape ``(8 n - 7, 4)``.
        period: from one record to the next, s.
        limits: of the norm of the angular acceleration and of its three components, rad/s^2.
    """
    found, ride = Brake(FASTEST_BRAKE_RATE, 0), _ToolRide(q)
    for place, most in enumerate(limits):
        if math.isfinite(most):
            ride.component = place - 1
            rate, record = ride.change_rate(GUARD_TOLERANCE * most, period, _LOCAL * most)
            if rate < found.rate:
                found = Brake(rate, record)
    return found


def _past(earlier: Floats, following: Floats) -> Floats:
    """Return the way in a period at the last two records of what was before, by differences."""
    a, b, c = earlier.tolist()
    d, e = following.tolist()
    if a == b == c == d:
        return np.zeros(2)  # at rest
    return np.array([(6.0 * c - 2.0 * a - 3.0 * b - d) / 6.0, (8.0 * (d - b) - (e - a)) / 12.0])


class _Ride(ABC):
    """One quantity over the records, at every eighth of a period; all in rad and periods.

    Attributes:
        count: periods.
    """

    count: int

    @abstractmethod
    def bend(self) -> Floats:
        """Return the largest acceleration around each period."""

    @abstractmethod
    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest difference of *order* around each period, of setpoints so far apart.

        Args:
            order: 1 to 3.
            reach: from one setpoint to the next, eighths of a period.
        """

    def change_rate(
        self, most: float, period: float, counted: float = math.inf
    ) -> tuple[float, int]:
        """Return the largest safe brake rate, 1/s, and the period that sets it.

        Args:
            most: limit of the acceleration, rad/s^2.
            period: from one record to the next, s.
            counted: up to which the path's own acceleration counts, rad/s^2.
        """
        unit = period * period
        speed = np.maximum(_widest(self.differences(1, 1) * PARTS, 2) / period, 1e-12)
        at_rates = [
            np.minimum(_widest(self.differences(2, reach), 1) / unit, counted)
            for reach in range(PARTS, PARTS // 2 - 1, -1)
        ]
        bend = self.bend() / unit
        # Just below the full rate, where a change has to be slow to end there.
        full, less = (size[:, None] for size in at_rates[:2])
        sizes = (
            full
            + _SHARES * (less - full)
            + 4.0 * _SHARES * (1.0 - _SHARES) * _BETWEEN * bend[:, None]
        )
        allowed = _MARGIN * np.min(np.maximum(most - sizes, 0.0) / _CHANGES, axis=1)
        # From rate to rate below that, and from half of the full one all the way down.
        for place, (one, other) in enumerate(pairwise(at_rates[1:]), 1):
            change = min(2.0, math.sqrt(8.0 * (place + 1) / PARTS))
            size = np.maximum(one, other) + _BETWEEN * bend
            allowed = np.minimum(allowed, np.maximum(most - size, 0.0) / change)
        spike = np.minimum(0.25 * bend, counted)
        allowed = np.minimum(allowed, np.maximum(most - spike, 0.0) / 2.0) / speed
        record = int(np.argmin(allowed))
        return min(float(allowed[record]), FASTEST_BRAKE_RATE), record

    def _around(self, sizes: Floats, lead: int) -> Floats:
        """Return the largest of *sizes* in each period, the first of which are *lead* eighths in.

        Each size counts where its last setpoint is, as the device takes it.
        """
        sizes = np.concatenate([np.zeros(lead), sizes])
        largest: Floats = sizes[: (self.count + 2) * PARTS].reshape(-1, PARTS).max(axis=1)
        return largest


class _JointRide(_Ride):
    """One joint, with two records before and one after those of the path."""

    def __init__(self, way: Floats, slope: Floats) -> None:
        step, leave, arrive = np.diff(way), slope[:-1], slope[1:]
        second, third = 3.0 * step - 2.0 * leave - arrive, leave + arrive - 2.0 * step
        u = np.arange(PARTS) / PARTS
        fine = way[:-1, None] + u * (leave[:, None] + u * (second[:, None] + u * third[:, None]))
        # Held after the last record for as long as a difference reaches.
        self._fine = np.concatenate([fine.ravel(), np.full(3 * PARTS + 1, way[-1])])
        ends = np.maximum(np.abs(2.0 * second), np.abs(2.0 * second + 6.0 * third))
        self._bend = _widest(np.concatenate([ends, [0.0, 0.0]]), 1)
        self.count = len(step)

    def bend(self) -> Floats:
        """Return the largest acceleration around each period."""
        return self._bend

    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest difference around each period; see :class:`_Ride`."""
        found = self._fine
        for _ in range(order):
            found = found[reach:] - found[:-reach]
        curve, found = np.abs(np.diff(found, 2)) / 8.0, np.abs(found)
        found[1:-1] += curve
        return self._around(found, order * reach)

    def check(self, axis: AxisLimits, period: float) -> None:
        """Raise :class:`.LimitError` if a difference at the full rate is beyond a limit.

        What ends before the first record is the past, which nothing can change.
        """
        limits = axis.velocity, axis.acceleration, axis.jerk
        for order, (kind, limit) in enumerate(zip(_UNITS, limits, strict=True), 1):
            if math.isinf(limit):
                continue
            sizes = self.differences(order, PARTS)[2:] / period**order
            at = int(np.argmax(sizes))
            if sizes[at] > limit * GUARD_TOLERANCE:
                raise LimitError(
                    f"{kind.value} of {axis.name}", float(sizes[at]), limit, at * period,
                    _UNITS[kind], "between two records; allow it more time", kind=kind,
                )  # fmt: skip

    def brake_rate(self, axis: AxisLimits, period: float) -> tuple[float, int]:
        """Return the largest safe brake rate, 1/s, and the period that sets it."""
        found = self.change_rate(GUARD_TOLERANCE * axis.acceleration, period)
        if math.isfinite(axis.jerk):
            speed = _widest(self.differences(1, 1) * PARTS, 2) / period
            full, twist = (
                _widest(self.differences(order, PARTS), 1) / period**order for order in (2, 3)
            )
            most = GUARD_TOLERANCE * axis.jerk
            found = min(found, brake_rate(speed[:, None], full[:, None], twist, np.inf, most))
        return found


class _ToolRide(_Ride):
    """The orientation of the tool.

    Attributes:
        component: of the differences that is looked at; -1 is their norm.
    """

    def __init__(self, q: Floats) -> None:
        self._fine = np.concatenate([q, np.repeat(q[-1:], 3 * PARTS, axis=0)])
        self.component = -1
        self.count = (len(q) - 1) // PARTS

    def bend(self) -> Floats:
        """Return the largest acceleration around each period."""
        return _widest(self.differences(2, 1) * PARTS**2, 1)

    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest difference around each period; see :class:`_Ride`."""
        found = log(multiply(conjugate(self._fine[:-reach]), self._fine[reach:]))
        for _ in range(order - 1):
            found = found[reach:] - found[:-reach]
        part = self.component
        sizes = np.linalg.norm(found, axis=1) if part < 0 else np.abs(found[:, part])
        return self._around(sizes, order * reach)


def _widest(sizes: Floats, reach: int) -> Floats:
    """Return the largest of each size and its neighbours up to *reach* away."""
    padded = np.pad(sizes, reach, mode="edge")
    found: Floats = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1)
    return found
