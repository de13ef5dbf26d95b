"""Targets, and the smooth motion that they describe together.

The sender's time stamps count, not the arrival.  Between targets that turn the velocity runs
straight from one to the next.  Which targets have come by now is a matter of the network, so the
motion is read as long ago as targets have lately been stale, where it does not depend on that, and
carried from there to now with its velocity.  A steady motion is met without lag; a curved one is
ahead by half its acceleration times the square of the delay, evenly, through loss and jitter.  A
sender who stamps targets ahead by more than its jitter leaves no delay at all.

A target without velocity is an order to be there: it counts at once and is not joined to others;
so does one that is farther than :data:`JUMP` from what the one before it predicts.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.driver.floats import difference, exp, multiply, norm, normalize

LOOKAHEAD_NS = 1_000_000_000
"""How far ahead of its time a target may come: a wrong stamp must not lock the later ones out."""

CAPACITY = 1024
"""Targets that wait for their time, at most."""

FASTEST = 1000.0
"""Largest angular velocity believed of a target, rad/s, per component."""

JUMP = 0.1
"""From which surprise on a target is a new order rather than a correction, rad."""

TRUST = 0.05
"""For so long velocities are believed more than orientations, s: this averages the noise."""

LONGEST_DELAY_NS = 150_000_000
"""How stale targets may become before they are carried on without regard to their successors."""

GROWTH = 0.1
"""How fast the delay grows when targets are staler than ever, seconds per second."""

BENT = 0.05
"""For so long the last acceleration is believed beyond the newest target, s."""

RECOVERY = 0.02
"""How fast the delay shrinks again, seconds per second."""

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


class _Knot(NamedTuple):
    """A target as it is believed; one that *begins* something is not joined to those before."""

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    time_ns: int
    expires_ns: int
    begins: bool

    def carried(self, seconds: float) -> Quaternion:
        x, y, z = self.omega
        return multiply(self.q, exp((x * seconds, y * seconds, z * seconds)))


class Motion(NamedTuple):
    """The reference at an instant.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the reference's own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3


class Reference:
    """The motion that the targets describe."""

    def __init__(self, period: float) -> None:
        """Expect to be asked every *period* seconds."""
        self._period_ns = period * 1e9
        self._growth_ns = GROWTH * period * 1e9
        self._recovery_ns = RECOVERY * period * 1e9
        self._knots: deque[_Knot] = deque()
        self.clear()

    def clear(self) -> None:
        """Forget every target."""
        self._knots.clear()
        self._newest_ns: int | None = None
        self._delay_ns = 0.0

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
        if len(self._knots) >= CAPACITY:
            return f"{CAPACITY} targets wait already"
        self._knots.append(self._believed(normalize(q), omega or ZERO, time_ns, expires_ns))
        self._newest_ns = time_ns
        return ""

    def _believed(self, q: Quaternion, omega: Vector3, time_ns: int, expires_ns: int) -> _Knot:
        """Return the knot of a target: corrected by what the one before it predicts."""
        before = self._knots[-1] if self._knots else None
        if before is None or omega == ZERO or before.omega == ZERO:
            return _Knot(q, omega, ZERO, time_ns, expires_ns, True)
        seconds = (time_ns - before.time_ns) * 1e-9
        (a, b, c), (x, y, z), half = before.omega, omega, 0.5 * seconds
        there = multiply(before.q, exp((half * (a + x), half * (b + y), half * (c + z))))
        alpha = (x - a) / seconds, (y - b) / seconds, (z - c) / seconds
        x, y, z = surprise = difference(there, q)
        if norm(surprise) > JUMP:
            return _Knot(q, omega, ZERO, time_ns, expires_ns, True)
        share = seconds / (seconds + TRUST)
        q = normalize(multiply(there, exp((share * x, share * y, share * z))))
        return _Knot(q, omega, alpha, time_ns, expires_ns, False)

    @property
    def awaits(self) -> bool:
        """Whether there is a target whose time has not passed."""
        return bool(self._knots)

    def at(self, now_ns: int) -> Motion | None:
        """Return the motion at *now_ns*, or ``None`` without a live target."""
        knots = self._knots
        due, first = -1, 0
        for k, knot in enumerate(knots):
            if knot.time_ns > now_ns:
                break
            due = k
            if knot.begins:
                first = k
        if due < 0:
            return None
        if now_ns >= knots[due].expires_ns:
            for _ in range(due + 1):
                knots.popleft()
            self._delay_ns = 0.0
            return None
        for _ in range(first):
            knots.popleft()
        stale_ns = min(now_ns - knots[-1].time_ns, LONGEST_DELAY_NS)
        last_ns = self._delay_ns
        delay_ns = min(max(stale_ns, last_ns - self._recovery_ns, 0.0), last_ns + self._growth_ns)
        self._delay_ns = delay_ns
        while len(knots) > 1 and knots[1].time_ns <= now_ns - delay_ns and not knots[1].begins:
            knots.popleft()
        here = knots[0]
        since = (now_ns - here.time_ns) * 1e-9
        ahead = delay_ns * 1e-9
        if here.begins and since <= ahead:
            return Motion(normalize(here.carried(since)), here.omega, ZERO)
        since = max(since - ahead, 0.0)
        # What was read a cycle ago was read from a little less or more than a cycle before.
        pace = 1.0 - (delay_ns - last_ns) / self._period_ns
        if len(knots) == 1 or knots[1].begins:
            return _continued(here, since, ahead, pace)
        return _joined(here, knots[1], since, ahead, pace)


def _continued(here: _Knot, since: float, ahead: float, pace: float) -> Motion:
    """Return the motion *since* the last knot, carried *ahead* (both in s)."""
    (a, b, c), (x, y, z) = here.omega, here.alpha
    bent = min(since, BENT)
    t, u = since + ahead, bent * (since - 0.5 * bent + ahead)
    q = multiply(here.q, exp((t * a + u * x, t * b + u * y, t * c + u * z)))
    t = bent + pace * ahead if bent < BENT else bent
    omega = (a + t * x, b + t * y, c + t * z)
    return Motion(normalize(q), omega, here.alpha if bent < BENT else ZERO)


def _joined(here: _Knot, there: _Knot, since: float, ahead: float, pace: float) -> Motion:
    """Return the motion between two knots, *since* the first, carried *ahead* (both in s)."""
    span = (there.time_ns - here.time_ns) * 1e-9
    u = since / span
    (a, b, c), (d, e, f) = here.omega, there.omega
    alpha = x, y, z = (d - a) / span, (e - b) / span, (f - c) / span
    # Velocity runs straight from knot to knot; what the orientations say beyond, along a ramp.
    u2 = 0.5 * since * since
    q = multiply(here.q, exp((a * since + u2 * x, b * since + u2 * y, c * since + u2 * z)))
    u2 = 0.5 * span * span
    end = multiply(here.q, exp((a * span + u2 * x, b * span + u2 * y, c * span + u2 * z)))
    r, s, t = difference(end, there.q)
    share = u * u * (3.0 - 2.0 * u)
    q = multiply(q, exp((share * r, share * s, share * t)))
    rate = 6.0 * u * (1.0 - u) / span
    a, b, c = a + since * x, b + since * y, c + since * z
    q = normalize(multiply(q, exp((ahead * a, ahead * b, ahead * c))))
    ahead *= pace
    a, b, c = a + ahead * x + rate * r, b + ahead * y + rate * s, c + ahead * z + rate * t
    return Motion(q, (a, b, c), alpha)
