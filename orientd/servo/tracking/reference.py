"""Targets, and the smooth motion that they describe together.

The sender's time stamps count, not the arrival.  Between targets that turn the velocity runs
straight from one to the next.  Which targets have come by now is a matter of the network, so the
motion is read somewhat longer ago than targets have lately been stale, where it does not depend on
that, and carried from there to now with its velocity and the acceleration it has had on average.  A
motion of even velocity, or acceleration, is met without lag; a change of the acceleration comes
late.  Whatever is carried without lag is exaggerated at some frequency (a delay that is made up for
cannot do otherwise); this way it is for motions quicker than a hand's.  A target that comes behind
a newer one is put in its place as long as the motion has not been read there.  A sender who stamps
targets ahead by more than its jitter leaves no delay at all.

A target without velocity is an order to be there: it counts at once and is not joined to others;
so does one that is farther than :data:`JUMP` from what the one before it predicts.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, norm, normalize
from orientd.servo.tracking.estimate import Estimate, begun, updated
from orientd.tolerances import NORM_TOLERANCE

LOOKAHEAD_NS = 1_000_000_000
"""How far ahead of its time a target may come: a wrong stamp must not lock the later ones out."""

SORTED = 16
"""A target that comes late is put in its place before so many others at most."""

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

STEADY = 0.04
"""For so long the acceleration that carries a motion on is averaged at least, s."""

STEADIER = 1.2
"""The same in times of how long ago the motion is read."""

SETTLING = 0.008
"""Time in which the law follows an acceleration, s."""

SPARE = 1.3
"""How long ago the motion is read, in times of how stale targets have been."""

USUAL = 0.05
"""Share of the last spacing of targets in what counts as the usual one."""

DISTURBED = 1.25
"""From how many times what the usual spacing of targets and their usual age at arrival explain on
staleness tells of lost or late ones."""

BRIDGE = 1.5
"""From how many times the usual spacing of targets on one is missing between two."""

RECOVERY = 0.01
"""How fast the delay shrinks again, seconds per second."""


STILL = 1e-4
"""What is estimated to turn more slowly stands still, rad/s."""


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
    told: Quaternion
    estimate: Estimate | None

    def carried(self, seconds: float) -> Quaternion:
        x, y, z = self.omega
        return multiply(self.q, exp((x * seconds, y * seconds, z * seconds)))


class Motion(NamedTuple):
    """The reference at an instant.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the reference's own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
        swing: how much more that is by now, as it has changed lately, rad/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    swing: Vector3 = ZERO


class Reference:
    """The motion that the targets describe."""

    def __init__(self, period: float) -> None:
        """Expect to be asked every *period* seconds."""
        self._period_ns = period * 1e9
        self._growth_ns = GROWTH * period * 1e9
        self._recovery_ns = RECOVERY * period * 1e9
        self._knots: deque[_Knot] = deque()
        self.clear()

    @property
    def delay(self) -> float:
        """How long ago the motion is read, s."""
        return self._delay_ns * 1e-9

    @property
    def is_disturbed(self) -> bool:
        """Whether targets come later than their own spacing explains: some are lost, or late."""
        return self._stalest_ns > self._explained_ns

    @property
    def _explained_ns(self) -> float:
        """How stale targets become of which none is lost and all are equally old at arrival."""
        due_ns = max(self._spacing_ns + (self._youngest_ns or 0.0), 0.0)
        return DISTURBED * (due_ns + self._period_ns)

    def clear(self) -> None:
        """Forget every target."""
        self._knots.clear()
        self._newest_ns: int | None = None
        self._taken = 0
        self._spacing_ns = self._stalest_ns = 0.0
        self._youngest_ns: float | None = None
        self._settled = 0
        self._delay_ns = 0.0
        self._bend = ZERO

    def take(self, target: Target, now_ns: int) -> str:
        """Take a target.

        Returns:
            An empty string, or why it was refused.
        """
        q, omega, time_ns, expires_ns = target
        size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
        if not abs(size - 1.0) <= 2.0 * NORM_TOLERANCE:
            return f"expected a unit quaternion, got {q}"
        if omega is not None and not all(abs(x) <= FASTEST for x in omega):
            return f"expected an angular velocity within {FASTEST:g} rad/s, got {omega}"
        if time_ns > now_ns + LOOKAHEAD_NS:
            return f"stamped {(time_ns - now_ns) / 1e9:.6g} s ahead, the most is 1 s"
        if expires_ns <= now_ns or expires_ns <= time_ns:
            return "expired"
        if len(self._knots) >= CAPACITY:
            return f"{CAPACITY} targets wait already"
        knots, place = self._knots, len(self._knots)
        if self._newest_ns is not None and time_ns <= self._newest_ns:
            place = self._place(time_ns, now_ns)
            if place == 0:
                late = (self._newest_ns - time_ns) / 1e9
                return f"not newer than the newest one, {late:.6g} s older, nor to be sorted in"
        else:
            self._note_spacing(time_ns)
        self._note_age(now_ns - time_ns)
        self._taken += 1
        told = normalize(q)
        estimate = begun(told) if omega is None else None
        knots.insert(
            place, _Knot(told, omega or ZERO, ZERO, time_ns, expires_ns, True, told, estimate)
        )
        self._settled = min(self._settled, place)
        return ""

    def _note_spacing(self, newest_ns: int) -> None:
        """Note how far apart targets are, those between the newest ones counted."""
        if self._newest_ns is not None:
            spacing_ns = (newest_ns - self._newest_ns) / self._taken
            share = USUAL if self._spacing_ns else 1.0
            self._spacing_ns += share * (spacing_ns - self._spacing_ns)
        self._newest_ns, self._taken = newest_ns, 0

    def _note_age(self, age_ns: int) -> None:
        """Note how old targets are at least when they arrive; negative where they come ahead."""
        last_ns = self._youngest_ns
        self._youngest_ns = (
            age_ns if last_ns is None else min(age_ns, last_ns + RECOVERY * self._spacing_ns)
        )

    def _place(self, time_ns: int, now_ns: int) -> int:
        """Return before which knot a late target belongs, 0 if the motion has been read there."""
        knots = self._knots
        if time_ns <= now_ns - self._delay_ns:
            return 0
        for place in range(len(knots), max(len(knots) - SORTED, 1) - 1, -1):
            before = knots[place - 1].time_ns
            if before <= time_ns:
                return place if before < time_ns else 0
        return 0

    def _settle(self) -> None:
        """Believe the targets that came since the last time, and those behind them anew."""
        knots = self._knots
        for k in range(self._settled, len(knots)):
            knots[k] = _believed(knots[k - 1] if k else None, knots[k])
        self._settled = len(knots)

    @property
    def awaits(self) -> bool:
        """Whether there is a target whose time has not passed."""
        return bool(self._knots)

    def at(self, now_ns: int) -> Motion | None:
        """Return the motion at *now_ns*, or ``None`` without a live target."""
        if self._settled < len(self._knots):
            self._settle()
        motion = self._read(now_ns)
        self._settled = len(self._knots)
        return motion

    def _read(self, now_ns: int) -> Motion | None:
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
            self._bend = ZERO
            return None
        for _ in range(first):
            knots.popleft()
        stale_ns = now_ns - knots[-1].time_ns
        self._stalest_ns = max(self._stalest_ns - self._recovery_ns, stale_ns)
        stale_ns = min(SPARE * stale_ns, LONGEST_DELAY_NS)
        last_ns = self._delay_ns
        delay_ns = min(max(stale_ns, last_ns - self._recovery_ns, 0.0), last_ns + self._growth_ns)
        self._delay_ns = delay_ns
        while len(knots) > 1 and knots[1].time_ns <= now_ns - delay_ns and not knots[1].begins:
            knots.popleft()
        here = knots[0]
        since = (now_ns - here.time_ns) * 1e-9
        ahead = delay_ns * 1e-9
        if here.begins and since <= ahead:
            self._bend = ZERO
            return Motion(normalize(here.carried(since)), here.omega, ZERO)
        since = max(since - ahead, 0.0)
        if len(knots) == 1 or knots[1].begins:
            past = _continued(here, since)
        else:
            missing_ns = knots[1].time_ns - here.time_ns - BRIDGE * self._spacing_ns
            if missing_ns > 0.0:
                self._stalest_ns = max(self._stalest_ns, self._explained_ns + missing_ns)
            past = _joined(here, knots[1], since)
        # What was read a cycle ago was read from a little less or more than a cycle before.
        return self._carried(past, ahead, 1.0 - (delay_ns - last_ns) / self._period_ns)

    def _carried(self, past: Motion, ahead: float, pace: float) -> Motion:
        """Return the motion *ahead* (s) of one that was read, whose own time runs at *pace*."""
        q, (a, b, c), (x, y, z), _ = past
        u, v, w = self._bend
        period = self._period_ns * 1e-9
        share = period / max(STEADY, STEADIER * ahead)
        du, dv, dw = share * (x - u), share * (y - v), share * (z - w)
        u, v, w = self._bend = (u + du, v + dv, w + dw)
        half = 0.5 * ahead * ahead
        turn = (ahead * a + half * u, ahead * b + half * v, ahead * c + half * w)
        # The derivative of that, with the velocity, the delay and the average all changing.
        r, s, t = pace * ahead, (1.0 - pace) * ahead, half / period
        omega = (
            a + r * x + s * u + t * du,
            b + r * y + s * v + t * dv,
            c + r * z + s * w + t * dw,
        )
        # It is as late again as the law needs to follow an acceleration.
        lead = 0.0 if self.is_disturbed else (ahead + SETTLING) / period
        swing = (lead * du, lead * dv, lead * dw)
        return Motion(normalize(multiply(q, exp(turn))), omega, past.alpha, swing)


def _believed(before: _Knot | None, knot: _Knot) -> _Knot:
    """Return the knot of a target: corrected by what the one before it predicts."""
    if knot.estimate is not None:
        return _estimated(before, knot)
    omega, told = knot.omega, knot.told
    if before is None or omega == ZERO or before.omega == ZERO:
        return knot._replace(q=told, alpha=ZERO, begins=True)
    seconds = (knot.time_ns - before.time_ns) * 1e-9
    (a, b, c), (x, y, z), half = before.omega, omega, 0.5 * seconds
    there = multiply(before.q, exp((half * (a + x), half * (b + y), half * (c + z))))
    alpha = (x - a) / seconds, (y - b) / seconds, (z - c) / seconds
    x, y, z = surprise = difference(there, told)
    if norm(surprise) > JUMP:
        return knot._replace(q=told, alpha=ZERO, begins=True)
    share = seconds / (seconds + TRUST)
    q = normalize(multiply(there, exp((share * x, share * y, share * z))))
    return knot._replace(q=q, alpha=alpha, begins=False)


def _estimated(before: _Knot | None, knot: _Knot) -> _Knot:
    """Return the knot of a target without velocity, with the one that those before it tell of."""
    if before is None or before.estimate is None:
        found = begun(knot.told)
    else:
        found = updated(before.estimate, knot.told, (knot.time_ns - before.time_ns) * 1e-9)
    omega = found.omega if norm(found.omega) > STILL else ZERO
    begins = before is None or ZERO in (omega, before.omega) or found.begins
    return knot._replace(
        q=found.q,
        omega=omega,
        alpha=ZERO if begins else found.alpha,
        begins=begins,
        estimate=found,
    )


def _continued(here: _Knot, since: float) -> Motion:
    """Return the motion *since* the last knot, s."""
    (a, b, c), (x, y, z) = here.omega, here.alpha
    bent = min(since, BENT)
    u = bent * (since - 0.5 * bent)
    q = multiply(here.q, exp((since * a + u * x, since * b + u * y, since * c + u * z)))
    omega = (a + bent * x, b + bent * y, c + bent * z)
    return Motion(q, omega, here.alpha if bent < BENT else ZERO)


def _joined(here: _Knot, there: _Knot, since: float) -> Motion:
    """Return the motion between two knots, *since* the first, s."""
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
    omega = (a + since * x + rate * r, b + since * y + rate * s, c + since * z + rate * t)
    return Motion(q, omega, alpha)
