"""Targets of a pointing device: a point, an orientation or a plan, each predicted at a time.

The orientations are those of the flange, in the frame of the target: the earth frame, or the base
frame of the device.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Sequence
from math import atan2, hypot, radians
from typing import Literal

from orientd.client.prediction import RateCheck, moving, turning
from orientd.driver import IDENTITY, ZERO, Quaternion, Vector3
from orientd.floats import (
    combine,
    conjugate,
    cross,
    difference,
    dot,
    exp,
    multiply,
    norm,
    normalize,
    plus,
    rotate_back,
)

Axis = Literal["x", "y", "z"]
Roll = float | Literal["least"]

AXES: dict[str, Quaternion] = {
    "x": IDENTITY,
    "y": (0.5, 0.5, 0.5, 0.5),
    "z": (0.5, -0.5, -0.5, -0.5),
}
"""Turns of the tool that bring its x axis to each axis, and the others along in their order."""

NEAREST = 1e-6
"""Least distance of a point, m."""

_BACKWARDS = 1e-9  # one plus the cosine of a half turn
_STRAIGHT_UP = 1e-9  # sine of the angle from the vertical
_FASTEST = 100.0
"""Largest rate of the azimuth, rad/s: near the zenith it has no bound."""


class Sight(ABC):
    """A target at any time.

    Attributes:
        is_in_world: whether it is in the earth frame rather than in the base frame of the device.
        expires_ns: time from which it no longer counts; ``None`` for never.
    """

    is_in_world = True
    expires_ns: int | None = None

    @abstractmethod
    def at(self, time_ns: int, last: Quaternion) -> tuple[Quaternion, Vector3]:
        """Return the orientation at a time, and its angular velocity in its own frame, rad/s.

        *last* is the orientation of the target before, which decides a free roll.
        """


class PointSight(Sight):
    """A point that may move, with the least roll or a given one.

    Attributes:
        kind: see the constructor.
        roll: ``"least"``, or the angle about the line of sight, degrees.
        place: where to look from, m.
    """

    def __init__(
        self,
        distance: float,
        *,
        kind: tuple[str, Axis, bool],
        q_base: Quaternion = IDENTITY,
        q_flange_axis: Quaternion = IDENTITY,
    ) -> None:
        """Create it without a sample.

        Args:
            distance: of the point, approximately, m.
            kind: name of the frame, empty for the world; pointing axis; whether it is a direction.
            q_base: orientation of the frame of the points: in the world, or in the device's frame.
            q_flange_axis: turns the x axis to the pointing axis, in coordinates of the flange.
        """
        self.kind, self.is_in_world = kind, not kind[0]
        self.roll: Roll = "least"
        self.place = ZERO
        self._predictor = moving(distance)
        self._q_base, self._q_axis_flange = q_base, conjugate(q_flange_axis)

    @property
    def rates(self) -> RateCheck:
        """Whether the velocities of the samples fit their points."""
        return self._predictor.rates

    def take(self, point: Vector3, velocity: Vector3 | None, time_ns: int) -> bool:
        """Accept a sample, m and m/s; return whether it counts; see :class:`.Predictor`."""
        return self._predictor.take(point, velocity, time_ns)

    def at(self, time_ns: int, last: Quaternion) -> tuple[Quaternion, Vector3]:
        """Return orientation and angular velocity at a time; see :class:`Sight`."""
        point, velocity = self._predictor.at(time_ns)
        line = plus(point, self.place, -1.0)
        distance = max(norm(line), NEAREST)
        line = plus(ZERO, line, 1.0 / distance)
        rate = plus(ZERO, velocity, 1.0 / distance)
        flat = hypot(line[0], line[1])
        if self.roll == "least" or flat < _STRAIGHT_UP:
            before = multiply(
                multiply(conjugate(self._q_base), last), conjugate(self._q_axis_flange)
            )
            q, omega = least_turn(before, line), cross(line, rate)
        else:
            q, omega = level(line, rate, radians(self.roll))
        q = multiply(q, self._q_axis_flange)
        return normalize(multiply(self._q_base, q)), rotate_back(q, omega)


class TurnSight(Sight):
    """An orientation that may turn."""

    def __init__(self) -> None:
        """Create it without a sample."""
        self._predictor = turning()

    @property
    def rates(self) -> RateCheck:
        """Whether the angular velocities of the samples fit their orientations."""
        return self._predictor.rates

    def take(self, q: Quaternion, omega_body: Vector3 | None, time_ns: int) -> bool:
        """Accept a sample, rad/s; return whether it counts; see :class:`.Predictor`."""
        return self._predictor.take(q, omega_body, time_ns)

    def at(self, time_ns: int, last: Quaternion) -> tuple[Quaternion, Vector3]:  # noqa: ARG002 - no roll is free
        """Return orientation and angular velocity at a time; see :class:`Sight`."""
        return self._predictor.at(time_ns)


class PlanSight(Sight):
    """The orientations of a plan, at rest before and after it."""

    def __init__(
        self, times: Sequence[float], orientations: Sequence[Quaternion], start_ns: int
    ) -> None:
        """Create it from samples.

        Args:
            times: path times, s, ascending.
            orientations: one for each.
            start_ns: time at which the path time is 0.
        """
        self._times_ns = [start_ns + round(t * 1e9) for t in times]
        self._orientations = orientations

    def at(self, time_ns: int, last: Quaternion) -> tuple[Quaternion, Vector3]:  # noqa: ARG002 - no roll is free
        """Return orientation and angular velocity at a time; see :class:`Sight`."""
        times, qs = self._times_ns, self._orientations
        after = bisect_right(times, time_ns)
        if after in (0, len(times)):
            return qs[min(after, len(times) - 1)], ZERO
        span = times[after] - times[after - 1]
        way, done = difference(qs[after - 1], qs[after]), (time_ns - times[after - 1]) / span
        q = multiply(qs[after - 1], exp(plus(ZERO, way, done)))
        return normalize(q), plus(ZERO, way, 1e9 / span)


def least_turn(q: Quaternion, line: Vector3) -> Quaternion:
    """Return *q* turned by the least angle that brings its x axis to *line*, a unit vector."""
    axis = rotate_back(conjugate(q), (1.0, 0.0, 0.0))
    cosine = 1.0 + dot(axis, line)
    if cosine < _BACKWARDS:
        return multiply(q, (0.0, 0.0, 0.0, 1.0))
    return normalize(multiply(normalize((cosine, *cross(axis, line))), q))


def level(line: Vector3, rate: Vector3, roll: float) -> tuple[Quaternion, Vector3]:
    """Return the orientation whose x axis is a line of sight, at an angle from level.

    Args:
        line: unit vector, not vertical.
        rate: its derivative, 1/s.
        roll: angle about the line, rad.

    Returns:
        Orientation, and angular velocity in the frame of *line*, rad/s.
    """
    x, y, z = line
    flat = hypot(x, y)
    azimuth, elevation = atan2(y, x), atan2(z, flat)
    q = multiply(exp((0.0, 0.0, azimuth)), exp((0.0, -elevation, 0.0)))
    azimuth_rate = (x * rate[1] - y * rate[0]) / (flat * flat)
    azimuth_rate = min(max(azimuth_rate, -_FASTEST), _FASTEST)
    elevation_rate = flat * rate[2] - z * (x * rate[0] + y * rate[1]) / flat
    # The elevation turns about the y axis that the azimuth has turned.
    omega = combine((y, -x, 0.0), elevation_rate / flat, (0.0, 0.0, 1.0), azimuth_rate)
    return normalize(multiply(q, exp((roll, 0.0, 0.0)))), omega
