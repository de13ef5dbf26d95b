"""Targets, and where they say the device should be at any moment.

The sender's time stamps count, not the arrival.  A target stamped in the past is carried on with
its angular velocity; targets stamped ahead wait for their time and are joined by Hermite curves, so
that a sender who stamps them ahead by more than its jitter is followed as if there were none.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.driver.floats import exp, multiply, normalize
from orientd.servo.segment import PathPoint, Segment

LOOKAHEAD_NS = 1_000_000_000
"""How far ahead of its time a target may come: a wrong stamp must not lock the later ones out."""

CAPACITY = 1024
"""Targets that wait for their time, at most."""

FASTEST = 1000.0
"""Largest angular velocity believed of a target, rad/s, per component."""

_NORM_TOLERANCE = 1e-6


class Target(NamedTuple):
    """Where the device should be at an instant, and how it should turn there.

    Attributes:
        q: orientation ``(w, x, y, z)``; its sign does not matter.
        omega_body: angular velocity in the target's own frame, rad/s; ``None`` to hold there.
        time_ns: when it is valid, monotonic clock.
        expires_ns: from when on it says nothing any more.
    """

    q: Quaternion
    omega_body: Vector3 | None
    time_ns: int
    expires_ns: int


class Reference:
    """The motion that the targets describe."""

    def __init__(self, period: float) -> None:
        """Expect to be asked every *period* seconds."""
        self._period = period
        self._pending: deque[Target] = deque()
        self.clear()

    def clear(self) -> None:
        """Forget every target."""
        self._pending.clear()
        self._current: Target | None = None
        self._newest_ns: int | None = None
        self._segment: Segment | None = None
        self._last: Vector3 | None = None

    def take(self, target: Target, now_ns: int) -> str:
        """Take a target.

        Returns:
            An empty string, or why it was refused.
        """
        q, omega, time_ns, expires_ns = target
        size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
        if not abs(size - 1.0) <= 2.0 * _NORM_TOLERANCE:
            return f"expected a unit quaternion, got {q}"
        if omega is not None and not all(abs(x) <= FASTEST for x in omega):
            return f"expected an angular velocity within {FASTEST:g} rad/s, got {omega}"
        if self._newest_ns is not None and time_ns <= self._newest_ns:
            return f"not newer than the newest one, {(self._newest_ns - time_ns) / 1e9:.6g} s older"
        if time_ns > now_ns + LOOKAHEAD_NS:
            return f"stamped {(time_ns - now_ns) / 1e9:.6g} s ahead, the most is 1 s"
        if expires_ns <= now_ns or expires_ns <= time_ns:
            return "expired"
        if len(self._pending) >= CAPACITY:
            return f"{CAPACITY} targets wait already"
        self._pending.append(Target(normalize(q), omega, time_ns, expires_ns))
        self._newest_ns = time_ns
        return ""

    def at(self, now_ns: int) -> tuple[Quaternion, Vector3, Vector3] | None:
        """Return the motion at *now_ns*, or ``None`` without a live target.

        Returns:
            Orientation; angular velocity of the period before, as a backward difference would have
            it, rad/s; its rate of change, rad/s^2, zero where the motion is carried on.
        """
        pending, last = self._pending, self._last
        self._last = None
        while pending and pending[0].time_ns <= now_ns:
            self._current = pending.popleft()
            self._segment = None
        current = self._current
        if current is None or now_ns >= current.expires_ns:
            return None
        x, y, z = omega = current.omega_body or ZERO
        elapsed = (now_ns - current.time_ns) * 1e-9
        if not pending or pending[0].time_ns > current.expires_ns:
            turned = exp((x * elapsed, y * elapsed, z * elapsed))
            return normalize(multiply(current.q, turned)), omega, ZERO
        span = (pending[0].time_ns - current.time_ns) * 1e-9
        if self._segment is None:
            self._segment = Segment(_point(current), _point(pending[0]), span)
        point = self._segment.at(elapsed / span)
        self._last = omega = u, v, w = point.omega_body
        if last is None:
            return point.q, omega, ZERO
        h = self._period
        alpha = a, b, c = (u - last[0]) / h, (v - last[1]) / h, (w - last[2]) / h
        h *= 0.5
        return point.q, (u - h * a, v - h * b, w - h * c), alpha


def _point(target: Target) -> PathPoint:
    return PathPoint(target.q, target.omega_body or ZERO, ZERO, ZERO, ZERO)
