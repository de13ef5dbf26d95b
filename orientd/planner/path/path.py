"""A path: segments of curves laid end to end in time, with the position that goes along.

A segment is a curve run at a constant rate, backwards where the rate is negative.  So one class
serves a curve as it is, a curve whose timing was found by the planner, and a run-up, which is a
lead-out run backwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from orientd.curves import Curve
from orientd.kernels import farthest_from_path, sample_path
from orientd.planner.path.plain_path import plain_path
from orientd.planner.path.position import PositionPath
from orientd.planner.request import Frame, State
from orientd.rotation import Floats, angle, conjugate, rotate

_AT_REST = 1e-9
"""Seconds before its end that a path counts as ended: its last record is at rest, to rounding."""


_ROUNDING = 1e-13
"""Share of a curve's duration that a segment of all of it may miss."""


class PathSamples(NamedTuple):
    """A path at some instants, one row each.

    Attributes:
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``; the sign is continuous
            along the path.
        omega_body: angular velocities in the body frame, rad/s, shape ``(n, 3)``.
        alpha_body: their derivatives in body components, rad/s^2, shape ``(n, 3)``.
        position: of the tool in the world, m, shape ``(n, 3)``.
        velocity: its derivative, m/s, shape ``(n, 3)``.
    """

    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats

    def seen_in(self, frame: Frame) -> PathSamples:
        """Return how the tool of a frame moves, seen from its base, where these are the flange's.

        Args:
            frame: its base in the world, and its tool on the flange.
        """
        q, position = frame.pose(self.q, self.position)
        # What turns about the flange moves the tool on its lever.
        lever = rotate(self.q, np.cross(self.omega_body, frame.tool.position))
        return self._replace(
            q=q,
            omega_body=frame.vector(self.omega_body),
            alpha_body=frame.vector(self.alpha_body),
            position=position,
            velocity=rotate(conjugate(frame.base.q), self.velocity + lever),
        )


@dataclass(frozen=True, slots=True, eq=False)
class PathSegment:
    """A curve over an interval of path time.

    Attributes:
        curve: the geometry.
        begin: path time where it begins, s.
        end: path time where it ends, s.
        rate: curve seconds for a second of path time; negative runs the curve backwards.
        sign: of the quaternions, to make them continuous with the segment before.
        skipped: path seconds of the curve that are left out before it begins.
    """

    curve: Curve
    begin: float
    end: float
    rate: float = 1.0
    sign: float = 1.0
    skipped: float = 0.0
    _found: list[tuple[Floats, Floats, Floats]] = field(repr=False, default_factory=list)
    """What the curve is at both ends, once that was asked for; of a copy that is moved, too."""

    def sample(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return orientation, velocity and acceleration at path *times* inside the segment."""
        first, last = self.curve.domain
        instants = times - self.begin
        if self.skipped:
            instants += self.skipped
        if self.rate != 1.0:
            instants *= self.rate
        instants += first if self.rate > 0.0 else last
        np.minimum(np.maximum(instants, first, out=instants), last, out=instants)
        return self._lined_up(*self.curve.evaluate(instants))

    def _lined_up(self, q: Floats, omega: Floats, alpha: Floats) -> tuple[Floats, Floats, Floats]:
        """Return samples of the curve as those of the segment."""
        if self.sign < 0.0:
            q = -q
        if self.rate != 1.0:
            omega, alpha = omega * self.rate, alpha * self.rate**2
        return q, omega, alpha

    def ends(self) -> tuple[State, State]:
        """Return the states at both ends; their positions are left at the origin."""
        q, omega, alpha = self._lined_up(*self._curve_at_ends())
        zero = np.zeros(3)
        return State(q[0], omega[0], alpha[0], zero), State(q[1], omega[1], alpha[1], zero)

    def end_orientations(self) -> tuple[Floats, Floats]:
        """Return the orientations at both ends."""
        first, last = self._curve_at_ends()[0]
        return (first, last) if self.sign > 0.0 else (-first, -last)

    def _curve_at_ends(self) -> tuple[Floats, Floats, Floats]:
        if not self._found:
            self._found.append(self._evaluated_at_ends())
        return self._found[0]

    def _evaluated_at_ends(self) -> tuple[Floats, Floats, Floats]:
        first, last = self.curve.domain
        duration = self.end - self.begin
        if self.rate > 0.0 and abs(self.rate * duration / (last - first) - 1.0) <= _ROUNDING:
            return self.curve.ends()
        origin = first if self.rate > 0.0 else last
        elapsed = (self.skipped, duration + self.skipped)
        instants = [min(max(origin + self.rate * t, first), last) for t in elapsed]
        return self.curve.evaluate(np.array(instants))

    def without(self, duration: float) -> PathSegment:
        """Return the segment with its first seconds left out, the rest where it was."""
        return replace(
            self, begin=self.begin + duration, skipped=self.skipped + duration, _found=[]
        )

    def slowed(self, duration: float) -> PathSegment:
        """Return the same segment of a curve from path time 0 on, taking *duration* seconds."""
        rate = self.rate * (self.end - self.begin) / duration
        return PathSegment(self.curve, 0.0, duration, rate, self.sign, self.skipped, self._found)

    def shifted(self, delay: float) -> PathSegment:
        """Return the same segment *delay* seconds later."""
        begin, end = self.begin + delay, self.end + delay
        return PathSegment(self.curve, begin, end, self.rate, self.sign, self.skipped, self._found)

    def turned_over(self) -> PathSegment:
        """Return the same segment with the other quaternions of its orientations."""
        return replace(self, sign=-self.sign)


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Orientation and position as functions of path time, held before and after.

    Attributes:
        segments: end to end, from path time 0 on.
        positions: what the position does.
        first: orientation before path time 0.
        last: orientation after the end.
    """

    segments: tuple[PathSegment, ...]
    positions: PositionPath
    first: Floats
    last: Floats
    _plain: list[Floats | None] = field(repr=False, default_factory=list)

    @classmethod
    def joined(
        cls, segments: Sequence[PathSegment], positions: PositionPath, before: Floats | None = None
    ) -> Path:
        """Return the path of *segments*, with the signs of the quaternions made continuous.

        Args:
            segments: end to end.
            positions: what the position does.
            before: the orientation the device comes from, whose sign goes on.
        """
        lined_up: list[PathSegment] = []
        for segment in segments:
            start, end = segment.end_orientations()
            if before is not None and sum((start * before).tolist()) < 0.0:
                start, end, segment = -start, -end, segment.turned_over()
            if not lined_up:
                first = start
            lined_up.append(segment)
            before = end
        if before is None or not lined_up:
            raise ValueError("segments must not be empty")
        return cls(tuple(lined_up), positions, first, before)

    def since(self, time: float) -> list[PathSegment]:
        """Return the segments after *time*, where they were."""
        return [
            segment.without(time - segment.begin) if segment.begin < time else segment
            for segment in self.segments
            if segment.end > time
        ]

    @property
    def plain(self) -> Floats | None:
        """The row of numbers that the kernels sample it from, if they do."""
        if not self._plain:
            end = self.duration - _AT_REST
            self._plain.append(plain_path(self.segments, self.first, self.last, end))
        return self._plain[0]

    @property
    def duration(self) -> float:
        """Path time from the first instant to the last, s."""
        return self.segments[-1].end

    def joints_before(self, record: int) -> tuple[tuple[float, ...], ...]:  # noqa: ARG002
        """Return nothing: a path that was not made for a device's axes knows none."""
        return ()

    def sample(self, times: Floats) -> PathSamples:
        """Return the path at *times*, in any order; beyond its ends it is held.

        Raises:
            ValueError: an instant is not a number.
        """
        is_sorted = bool((times[1:] >= times[:-1]).all())
        if not (is_sorted and len(times) > 1) and np.isnan(times).any():
            raise ValueError("times must be numbers, got nan")
        if not is_sorted:
            order = np.argsort(times, kind="stable")
            back = np.argsort(order)
            return PathSamples(*(part[back] for part in self.sample_in_order(times[order])))
        return self.sample_in_order(times)

    def sample_in_order(self, times: Floats) -> PathSamples:
        """Return the path at increasing *times*; beyond its ends it is held."""
        position, velocity = self.positions.sample(times)
        if not self.positions.is_held:
            first, last = self._ends(times)
            velocity[:first] = velocity[last:] = 0.0
            position[last:] = self.positions.last
        rows = self._rows(times, 10)
        return PathSamples(rows[:4].T, rows[4:7].T, rows[7:].T, position, velocity)

    def push(self, times: Floats) -> Floats:
        """Return the accelerations of the position at *times*, m/s^2, shape ``(n, 3)``."""
        return self.positions.push(times)

    def setpoints(self, first: int, size: int, period: float) -> tuple[Floats, Floats]:
        """Return rows and positions at multiples of a period from the *first* one on.

        Returns:
            Orientations, velocities and accelerations, shape ``(size, 10)``, and positions, shape
            ``(size, 3)``; positions that are all the same come as one, ``(1, 3)``.
        """
        times = period * np.arange(first, first + size, dtype=np.float64)
        q = self._rows(times, 10).T
        if self.positions.is_held:
            return q, self.positions.first[None]
        position, _ = self.positions.sample(times)
        position[self._ends(times)[1] :] = self.positions.last
        return q, position

    def orientations(self, times: Floats) -> Floats:
        """Return the orientations at increasing *times*, shape ``(n, 4)``."""
        return self._rows(times, 4).T

    def farthest_from(self, keys: Floats, times: Floats) -> float:
        """Return the largest angle between *keys* and the path at increasing *times*, rad."""
        if self.plain is None:
            return float(np.max(angle(self.orientations(times), keys)))
        instants, wanted = np.ascontiguousarray(times), np.ascontiguousarray(keys)
        return farthest_from_path(self.plain, instants, wanted)

    def _ends(self, times: Floats) -> tuple[int, int]:
        """Return where the path begins and ends in increasing *times*."""
        first, last = np.searchsorted(times, [0.0, self.duration - _AT_REST]).tolist()
        return min(first, last), last

    def _rows(self, times: Floats, count: int) -> Floats:
        """Return orientations at increasing *times*, and velocities and accelerations if asked for.

        Returns:
            Shape ``(count, n)``, where *count* is 4 or 10.
        """
        if self.plain is not None:
            rows: Floats = np.empty((count, len(times)))
            sample_path(self.plain, np.ascontiguousarray(times), rows)
            return rows
        first, last = self._ends(times)
        rows = np.zeros((count, len(times)))
        rows[:4, :first], rows[:4, last:] = self.first[:, None], self.last[:, None]
        begins = [segment.begin for segment in self.segments[1:]]
        edges = np.minimum(np.searchsorted(times, begins), last).tolist()
        for segment, begin, end in zip(self.segments, [first, *edges], [*edges, last], strict=True):
            if begin < end:
                parts = segment.sample(times[begin:end])
                rows[:, begin:end] = np.concatenate([part.T for part in parts])[:count]
        return rows

    def state(self, time: float) -> State:
        """Return the state at *time*, with the derivatives of the segment that begins there."""
        for segment in self.segments:
            if time < segment.end or segment is self.segments[-1]:
                break
        q, omega, alpha = segment.sample(np.array([time]))
        return State(q[0], omega[0], alpha[0], *self.positions.state(time))
