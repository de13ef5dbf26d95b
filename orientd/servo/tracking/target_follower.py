"""The pursuit of targets: from the ring they arrive in to the setpoint of the cycle."""

from __future__ import annotations

from collections.abc import Sequence
from math import dist

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import norm
from orientd.servo.tracking.approach import approach, stopping_distance
from orientd.servo.tracking.knot import Knot, Target
from orientd.servo.tracking.tracker import Tracker
from orientd.stream import RecordRing, ServoLimits

TARGETS_PER_CYCLE = 8
"""Targets taken in one cycle; the others wait."""

LEFT_OUT_WORD = 1
"""Word of the ring of targets: how many have been left out."""


class TargetFollower:
    """Targets of one ring, followed.

    Attributes:
        is_on: whether targets are followed, or their following is coming to rest.
        tracker: on the way to the target of the moment.
    """

    def __init__(self, ring: RecordRing, period: float) -> None:
        """Follow nothing yet; cycles are *period* seconds apart."""
        self.is_on = False
        self._ring = ring
        self._period = period
        self.tracker = Tracker(period)
        self._next = ring.head
        self._left_out = 0
        self._landing: Knot | None = None

    def begin(
        self, q: Quaternion, omega: Vector3, alpha: Vector3, servo_limits: ServoLimits
    ) -> None:
        """Begin from what was last commanded; targets of before do not count.

        Args:
            q: orientation last commanded.
            omega: angular velocity of the step to it, rad/s.
            alpha: change from the step before over the period, rad/s^2.
            servo_limits: limits.
        """
        self.tracker.begin(q, omega, alpha, servo_limits)
        self._next = self._ring.head
        self.is_on = True

    def end(self) -> None:
        """Follow no more."""
        self.is_on = False

    def position(
        self, position: Vector3, velocity: Vector3, servo_limits: ServoLimits
    ) -> Vector3 | None:
        """Return the next position, m; ``None`` if it is to come to rest, wherever that is.

        Args:
            position: last commanded, m.
            velocity: of the step to it, m/s.
            servo_limits: limits.
        """
        place = self.tracker.place
        if place is None:
            return None
        (a, b, c), goal_velocity = place
        x, y, z = position
        if self.tracker.end is not None:
            knot, left = self.tracker.end
            if knot is not self._landing and knot.told_position is not None:
                stop = stopping_distance(norm(velocity), servo_limits.linear_acceleration)
                stop += 2.0 * self._period * norm(velocity)
                if dist(position, knot.told_position) <= stop >= 0.5 * left * norm(velocity):
                    self._landing = knot
            if knot is self._landing and knot.told_position is not None:
                (a, b, c), goal_velocity = knot.told_position, ZERO
        h = self._period
        u, v, w = approach(
            (a - x, b - y, c - z),
            velocity,
            goal_velocity,
            fastest=servo_limits.linear_velocity,
            acceleration=servo_limits.linear_acceleration,
            period=h,
        )
        return (x + h * u, y + h * v, z + h * w)

    def aim(self, now_ns: int) -> None:
        """Take the targets that have arrived."""
        ring = self._ring
        head = ring.head
        if self._next == head:
            return
        self._next = ring.oldest(self._next)
        for index in range(self._next, min(head, self._next + TARGETS_PER_CYCLE)):
            fields = ring.read(index)
            if fields is None and head - index < ring.capacity:
                return  # still being written
            self._next = index + 1
            if fields is not None:
                _, time_ns, expires_ns, w, x, y, z, *more = fields
                omega, position = _given(more[:3]), _given(more[3:])
                target = Target((w, x, y, z), omega, time_ns, expires_ns, position)
                if not self.tracker.take(target, now_ns):
                    continue
            self._left_out += 1
            ring.words[LEFT_OUT_WORD] = self._left_out


def _given(vector: Sequence[float]) -> Vector3 | None:
    """Return a vector of a record; ``None`` for :data:`~orientd.stream.NOT_GIVEN`."""
    x, y, z = vector
    return None if x != x and y != y and z != z else (x, y, z)
