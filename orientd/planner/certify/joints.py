r"""How fast a path that is known at its records can slow down, for joints and for the tool.

Between two records the servo interpolates every joint, and the rotation vector of the tool, with a
cubic Hermite (:mod:`orientd.servo.path.segment`).  The device takes differences of setpoints.  Let
:math:`\sigma_1, \sigma_2` be the rates of two cycles and :math:`\sigma` their mean.  The second
difference is

.. math::
    \Delta^2\theta = (\sigma_2 - \sigma_1)\, \bar v + \sigma^2 \bar a

with means :math:`\bar v, \bar a` of the cubics' velocity and acceleration, over a cycle and over
two.  So it is the inequality of :mod:`orientd.planner.certify.brake` in one dimension.  The mean
:math:`\bar a` at a rate is the second difference of setpoints with that rate, for any phase
relative to the records.

The differences are computed at every eighth of a period, for every eighth of a rate from 1 down to
a half.  Between these places a difference is larger by at most an eighth of its own second
difference. Between these rates the cubics' acceleration bounds the difference.  Below half of the
full rate that acceleration itself bounds the mean: a spike of it, as cubics have next to a step,
counts a quarter there.

The tool's differences count up to 95 % of the limit, as in ``brake.c``: the path is certified at
full speed, and a share of the limit is reserved for braking.
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
from orientd.kernels import turn_sizes
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, brake_rate
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

PARTS = 8
"""Places in a period, and rates below the full one, at which differences are computed."""

_BETWEEN = 2.0 / (8.0 * PARTS**2)
"""Share of the cubics' acceleration that a difference between two rates can add."""

_SHARES = 8.0 * np.geomspace(1e-5, 0.125, 24)
"""Point between the full rate and the next one at which a rate change is checked."""
_CHANGES = np.sqrt(_SHARES)
"""Fastest change of the rate at that point, by the brake rate."""
_MARGIN = 0.99
"""Margin for rates between these."""

_LOCAL = 0.95
"""Share of the tool's limit up to which its acceleration counts, as in ``brake.c``."""

_UNITS = {
    LimitKind.VELOCITY: "rad/s",
    LimitKind.ACCELERATION: "rad/s^2",
    LimitKind.JERK: "rad/s^3",
}


class Brake(NamedTuple):
    """How fast a path can slow down.

    Attributes:
        rate: largest safe brake rate, 1/s.
        record: the record that sets it.
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
    """Return how fast a path can slow down within the limits of the joints.

    Args:
        joints: at the records of the path, rad, shape ``(n, joints)``; the device stays at the
            last.
        rates: joint velocities at the records, rad/s, same shape.
        earlier: joints at the three records before the path, oldest first, rad, shape ``(3,
            joints)``.
        period: time between two records, s.
        axes: limits of every joint.

    Raises:
        LimitError: a joint breaks a limit at some phase of the setpoints relative to the records.
    """
    way = np.concatenate([earlier[-2:], joints, joints[-1:]])
    held = np.zeros((1, len(axes)))
    slope = np.concatenate([_past(earlier, joints[:2]), rates * period, held])
    ride = _JointRide(way, slope)
    ride.check(axes, period)
    most = GUARD_TOLERANCE * np.array([axis.acceleration for axis in axes])
    found = ride.brake(most, period)
    twisted = [place for place, axis in enumerate(axes) if math.isfinite(axis.jerk)]
    if twisted:
        found = min(found, *(ride.jerk_brake(place, axes[place], period) for place in twisted))
    return Brake(found.rate, max(found.record - 2, 0))


def tool_brake(q: Floats, period: float, limits: Sequence[float]) -> Brake:
    """Return how fast a path can slow down within the limits of the tool's acceleration.

    Args:
        q: orientations at every eighth of a period, from the first record to the last, where the
            device stays, shape ``(8 n - 7, 4)``.
        period: time between two records, s.
        limits: of the norm of the angular acceleration and of its three components, rad/s^2.
    """
    most = np.array(limits)
    return _ToolRide(q).brake(GUARD_TOLERANCE * most, period, _LOCAL * most)


def _past(earlier: Floats, following: Floats) -> Floats:
    """Return the motion per period at the last two records before the path, by differences."""
    a, b, c = earlier
    d, e = following
    found = np.stack([(6.0 * c - 2.0 * a - 3.0 * b - d) / 6.0, (8.0 * (d - b) - (e - a)) / 12.0])
    found[:, (a == b) & (b == c) & (c == d)] = 0.0  # at rest
    return found


class _Ride(ABC):
    """Quantities over the records, at every eighth of a period; all in rad and periods.

    Attributes:
        count: number of periods.
    """

    count: int

    @abstractmethod
    def bends(self) -> Floats:
        """Return the largest accelerations around each period, one column per quantity."""

    @abstractmethod
    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest differences of *order* around each period, for a setpoint distance.

        Args:
            order: 1 to 3.
            reach: from one setpoint to the next, eighths of a period.

        Returns:
            One row per period, one column per quantity.
        """

    def brake(self, most: Floats, period: float, counted: Floats | float = math.inf) -> Brake:
        """Return the largest safe brake rate, and the period that sets it.

        Args:
            most: limits of the accelerations, rad/s^2.
            period: time between two records, s.
            counted: cap on the path's own accelerations, rad/s^2.
        """
        unit = period * period
        speed = np.maximum(self.speeds(period), 1e-12)
        at_rates = [
            np.minimum(_widest(self.differences(2, reach), 1) / unit, counted)
            for reach in range(PARTS, PARTS // 2 - 1, -1)
        ]
        bend = self.bends() / unit
        spike = np.minimum(0.25 * bend, counted)
        allowed = (most - spike) / 2.0
        # Just below the full rate, where a rate change must be slow enough to end.
        full, less = at_rates[:2]
        between = 4.0 * _BETWEEN * bend
        for share, change in zip(_SHARES.tolist(), _CHANGES.tolist(), strict=True):
            size = full + share * (less - full) + share * (1.0 - share) * between
            np.minimum(allowed, (most - size) * (_MARGIN / change), out=allowed)
        # From rate to rate below that, and from half of the full rate down to zero.
        for place, (one, other) in enumerate(pairwise(at_rates[1:]), 1):
            change = min(2.0, math.sqrt(8.0 * (place + 1) / PARTS))
            size = np.maximum(one, other) + _BETWEEN * bend
            np.minimum(allowed, (most - size) / change, out=allowed)
        allowed = np.maximum(allowed, 0.0) / speed
        record = int(np.argmin(np.min(allowed, axis=1)))
        return Brake(min(float(allowed[record].min()), FASTEST_BRAKE_RATE), record)

    def speeds(self, period: float) -> Floats:
        """Return the largest velocities around each period, rad/s."""
        return _widest(self.differences(1, 1) * PARTS, 2) / period


class _JointRide(_Ride):
    """The joints, with two records before the path and one after it."""

    def __init__(self, way: Floats, slope: Floats) -> None:
        step, leave, arrive = np.diff(way, axis=0), slope[:-1], slope[1:]
        second, third = 3.0 * step - 2.0 * leave - arrive, leave + arrive - 2.0 * step
        u = (np.arange(PARTS) / PARTS)[:, None]
        law = leave[:, None] + u * (second[:, None] + u * third[:, None])
        fine = (way[:-1, None] + u * law).reshape(-1, way.shape[1])
        # Hold the last record for as long as a difference reaches.
        self._fine = np.concatenate([fine, np.repeat(way[-1:], 3 * PARTS + 1, axis=0)])
        ends = np.maximum(np.abs(2.0 * second), np.abs(2.0 * second + 6.0 * third))
        self._bends = _widest(np.concatenate([ends, np.zeros((2, way.shape[1]))]), 1)
        self.count = len(step)

    def bends(self) -> Floats:
        """Return the largest accelerations of the cubics around each period."""
        return self._bends

    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest differences around each period; see :class:`_Ride`."""
        found = self._fine
        for _ in range(order):
            found = found[reach:] - found[:-reach]
        curve = np.abs(found[2:] + found[:-2] - 2.0 * found[1:-1])
        found = np.abs(found)
        found[1:-1] += 0.125 * curve
        # Each one counts at its last setpoint, as for the device.
        sizes = np.zeros(((self.count + 2) * PARTS, found.shape[1]))
        sizes[order * reach :] = found[: len(sizes) - order * reach]
        largest = sizes[::PARTS].copy()
        for part in range(1, PARTS):
            np.maximum(largest, sizes[part::PARTS], out=largest)
        return largest

    def check(self, axes: Sequence[AxisLimits], period: float) -> None:
        """Raise :class:`.LimitError` if a difference at the full rate exceeds a limit.

        Differences that end before the first record are in the past and are ignored.
        """
        for order, kind in enumerate(_UNITS, 1):
            limits = np.array([getattr(axis, kind.value) for axis in axes])
            if np.all(np.isinf(limits)):
                continue
            sizes = self.differences(order, PARTS)[2:] / period**order
            worst = int(np.argmax(np.max(sizes, axis=0) / limits))
            at = int(np.argmax(sizes[:, worst]))
            value, limit = float(sizes[at, worst]), float(limits[worst])
            if value > limit * GUARD_TOLERANCE:
                raise LimitError(
                    f"{kind.value} of {axes[worst].name}", value, limit, at * period,
                    _UNITS[kind], "between two records; allow it more time", kind=kind,
                )  # fmt: skip

    def jerk_brake(self, place: int, axis: AxisLimits, period: float) -> Brake:
        """Return the largest safe brake rate for the jerk of one axis with a jerk limit."""
        speed = self.speeds(period)[:, place : place + 1]
        bend, twist = (
            _widest(self.differences(order, PARTS), 1)[:, place] / period**order for order in (2, 3)
        )
        most = GUARD_TOLERANCE * axis.jerk
        return Brake(*brake_rate(speed, bend[:, None], twist, np.inf, most))


class _ToolRide(_Ride):
    """The turn of the tool: its norm and its three components in the body frame."""

    def __init__(self, q: Floats) -> None:
        self._fine = np.concatenate([q, np.repeat(q[-1:], 3 * PARTS, axis=0)])
        self.count = (len(q) - 1) // PARTS

    def bends(self) -> Floats:
        """Return the largest accelerations around each period."""
        return _widest(self.differences(2, 1) * PARTS**2, 1)

    def differences(self, order: int, reach: int) -> Floats:
        """Return the largest differences around each period; see :class:`_Ride`."""
        found: Floats = np.empty((self.count + 2, 4))
        turn_sizes(self._fine, order, reach, PARTS, found)
        return found


def _widest(sizes: Floats, reach: int) -> Floats:
    """Return the largest of each row and its neighbours within *reach*, column by column."""
    found = sizes.copy()
    for away in range(1, reach + 1):
        np.maximum(found[away:], sizes[:-away], out=found[away:])
        np.maximum(found[:-away], sizes[away:], out=found[:-away])
    return found
