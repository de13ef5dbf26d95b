"""Targets, and the smooth motion that they describe together.

The sender's time stamps count, not the arrival times.  The buffer keeps the samples by their
stamps, at most :data:`CAPACITY`.  The reference is their forecast for now
(:mod:`orientd.servo.tracking.forecast`), of orientation and position.

A target at rest is an order to be there.  It counts at once and is not joined to others.  So does a
target far from the forecast.  A target without velocity gets the velocity of the previous ones,
until the next one is overdue.  Then it becomes an order too.

A target that arrives later replaces all waiting ones from its stamp on.  A target that is only
late, as networks make them, lies between its neighbours and is inserted, as long as it is not older
than targets have lately been.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import dist, inf
from typing import NamedTuple, cast

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, norm, normalize
from orientd.servo.tracking.forecast import WINDOW, Forecast, TimedValue
from orientd.servo.tracking.quintic import time_of
from orientd.tolerances import NORM_TOLERANCE

LOOKAHEAD_NS = 10_000_000_000
"""How far ahead of its time a target may arrive."""

CAPACITY = 10_000
"""Most waiting targets: one per millisecond."""

REMEMBERED_NS = 600_000_000
"""How long targets are kept that have passed."""

AGREEING = 5e-3
"""How much longer the path through a late target may be than between its neighbours, rad or m."""

LARGEST = 1000.0
"""Largest plausible component of an angular velocity or a position, rad/s or m."""

LONGEST_DELAY_NS = 150_000_000
"""Age beyond which a target is too late to count."""

GROWTH = 0.1
"""Growth of the delay when targets are later than ever, seconds per second."""

RECOVERY = 0.01
"""Decrease of the delay, seconds per second."""

SPARE = 1.3
"""The delay in multiples of the lateness of targets."""

STILL = 1e-4
"""Rate below which a target without velocity stands still, rad/s."""

STILL_FOR = 0.1
"""Time for which its acceleration does not change that, s."""

UNEVEN = 1.25
"""Longest gap of an even stream, in multiples of the usual gap, plus two cycles."""

SILENT = 4.0
"""Gap that ends an uneven stream, in multiples of the usual gap, plus :data:`SILENT_NS`."""

SILENT_NS = 50_000_000

PAUSE_NS = 250_000_000
"""A target this long after the newest one starts over, and does not count as a gap."""

USUAL = 0.05
"""Weight of the last gap in the usual one."""

FORGETTING = 0.01
"""Decay of the longest gap per gap."""


class Target(NamedTuple):
    """The pose for the device at a time, and its velocity there.

    Attributes:
        q: orientation ``(w, x, y, z)``; its sign does not matter.
        omega_body: angular velocity in the target's own frame, rad/s; zero to be at rest there,
            ``None`` to derive it from earlier targets.
        time_ns: time of the target, monotonic clock.
        expires_ns: time from which it no longer counts.
        position: m; ``None`` for a position at rest anywhere.
    """

    q: Quaternion
    omega_body: Vector3 | None
    time_ns: int
    expires_ns: int
    position: Vector3 | None = None


class ReferenceState(NamedTuple):
    """The reference at a time.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the reference's own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
        lead: expected change of that within a cycle, rad/s^2, for feed-forward.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    lead: Vector3 = ZERO


class Arrivals:
    """The gaps between arrivals; targets that arrive together count as one."""

    def __init__(self, period_ns: float) -> None:
        self._period_ns = period_ns
        self._arrived_ns = 0
        self._gap_ns = self._longest_ns = 0.0

    def note(self, newest_ns: int | None, now_ns: int) -> None:
        """Record an arrival; *newest_ns* is the time of the newest previous target."""
        gap_ns = now_ns - self._arrived_ns
        self._arrived_ns = now_ns
        if newest_ns is None or gap_ns <= 0:
            return
        if now_ns - newest_ns > max(PAUSE_NS, SILENT * self._gap_ns + SILENT_NS):
            return
        self._gap_ns += (USUAL if self._gap_ns else 1.0) * (gap_ns - self._gap_ns)
        self._longest_ns = max(gap_ns, self._longest_ns - FORGETTING * gap_ns)

    @property
    def next_ns(self) -> float:
        """Expected time of the next target, ns; infinity if it is not known yet."""
        return self._arrived_ns + self._gap_ns if self._gap_ns else inf

    @property
    def are_uneven(self) -> bool:
        """Whether targets were lost or late recently."""
        return self._longest_ns > UNEVEN * self._gap_ns + 2.0 * self._period_ns

    def have_ceased(self, now_ns: int) -> bool:
        """Whether the next target is overdue."""
        silence_ns = now_ns - self._arrived_ns
        if self.are_uneven:
            return silence_ns > SILENT * self._gap_ns + SILENT_NS
        return silence_ns > UNEVEN * self._gap_ns + 2.0 * self._period_ns


class Reference:
    """The motion that the targets describe.

    Attributes:
        last: the newest live target whose time has come.
    """

    def __init__(self, period: float) -> None:
        """Create it for one call per *period* seconds."""
        self._period, self._period_ns = period, period * 1e9
        self.clear()

    @property
    def is_disturbed(self) -> bool:
        """Whether targets were lost or late recently."""
        return self._arrivals.are_uneven

    @property
    def awaits(self) -> bool:
        """Whether there is a target whose time has not passed."""
        return bool(self._targets)

    def clear(self) -> None:
        """Forget every target."""
        self._targets: list[Target] = []
        # As the forecasts know them; positions are fewer.
        self._turns: list[TimedValue] = []
        self._places: list[TimedValue] = []
        self._arrivals = Arrivals(self._period_ns)
        self._version = 0
        self._newest_ns: int | None = None
        self._is_concluded = False
        self.last: Target | None = None
        self._forget()

    def _forget(self) -> None:
        self._delay_ns = 0.0
        self._turning = Forecast(self._period, is_turn=True)
        self._moving = Forecast(self._period, is_turn=False)

    def take(self, target: Target, now_ns: int) -> str:
        """Accept a target.

        Returns:
            An empty string, or why it was refused.
        """
        problem = _problem_of(target, now_ns)
        if problem:
            return problem
        targets, time_ns, newest_ns = self._targets, target.time_ns, self._newest_ns
        target = target._replace(q=normalize(target.q))
        place = len(targets)
        if newest_ns is not None and time_ns <= newest_ns:
            place = bisect_left(targets, time_ns, key=time_of)
            if time_ns > now_ns - 2.0 * self._period_ns:
                self._make_way(target, place, newest_ns)
            elif not self._has_room(time_ns, place, now_ns):
                late = (newest_ns - time_ns) / 1e9
                return f"not newer than the newest one, {late:.6g} s older, nor to be sorted in"
        elif place >= CAPACITY:
            return f"{CAPACITY} targets wait already"
        self._is_concluded = False
        self._arrivals.note(self._newest_ns, now_ns)
        if self._newest_ns is None or time_ns > self._newest_ns:
            self._newest_ns = time_ns
        targets.insert(place, target)
        self._turns.insert(place, TimedValue(time_ns, target.q, target.omega_body))
        if target.position is not None:
            place = bisect_left(self._places, time_ns, key=time_of)
            self._places.insert(place, TimedValue(time_ns, target.position))
        self._version += 1
        return ""

    def _make_way(self, target: Target, place: int, newest_ns: int) -> None:
        """Drop the targets that *target*, stamped before the newest one, replaces."""
        targets, time_ns = self._targets, target.time_ns
        if newest_ns - time_ns <= LONGEST_DELAY_NS and 0 < place < len(targets):
            before, after = targets[place - 1], targets[place]
            if _lies_between(before, target, after):
                if after.time_ns - time_ns < self._period_ns:
                    self._drop(place, place + 1)
                return
        self._drop(place, len(targets))
        self._newest_ns = time_ns

    def _drop(self, begin: int, end: int) -> None:
        """Drop the targets of these places."""
        if begin >= end:
            return
        first_ns, last_ns = self._targets[begin].time_ns, self._targets[end - 1].time_ns
        places = self._places
        del places[
            bisect_left(places, first_ns, key=time_of) : bisect_right(places, last_ns, key=time_of)
        ]
        del self._targets[begin:end], self._turns[begin:end]
        self._version += 1

    def _has_room(self, time_ns: int, place: int, now_ns: int) -> bool:
        """Whether a late target can be inserted: it is no older than others, nor replaces one."""
        targets = self._targets
        is_late = place == 0 or time_ns <= now_ns - self._delay_ns
        return not is_late and (place == len(targets) or targets[place].time_ns > time_ns)

    def at(self, now_ns: int) -> ReferenceState | None:
        """Return the motion at *now_ns*, or ``None`` without a live target."""
        targets = self._targets
        self.last = None
        if self._is_concluded and targets and now_ns < targets[-1].expires_ns:
            return self._at_rest(targets[-1])
        due = bisect_right(targets, now_ns, key=time_of) - 1
        if due < 0:
            return None
        if now_ns >= targets[due].expires_ns:
            self._drop(0, due + 1)
            self._forget()
            return None
        past = min(bisect_left(targets, now_ns - REMEMBERED_NS, key=time_of), due - WINDOW)
        if past > WINDOW:
            self._drop(0, past)
            due -= past
        self.last, newest = targets[due], targets[-1]
        stale_ns = now_ns - newest.time_ns
        is_open = newest.omega_body is None
        if is_open and stale_ns >= 0 and self._arrivals.have_ceased(now_ns):
            return self._at_rest(newest)
        self._delay_by(stale_ns)
        found = self._turning.at(self._turns, self._version, now_ns)
        q, omega, alpha, lead = cast(Quaternion, found.value), *found[1:]
        is_still = norm(omega) + STILL_FOR * norm(alpha) < STILL
        if self.last.omega_body == ZERO or (self.last.omega_body is None and is_still):
            return ReferenceState(self.last.q, ZERO, ZERO)
        return ReferenceState(q, omega, alpha, lead)

    def position_at(self, now_ns: int) -> tuple[Vector3, Vector3, Vector3] | None:
        """Return position, velocity and acceleration of the target at *now_ns*, if it has any.

        Call it after :meth:`at` for the same time.  The units are m and s.
        """
        last = self.last
        if last is None or last.position is None:
            return None
        is_end = last is self._targets[-1] and self._arrivals.have_ceased(now_ns)
        if is_end or self._is_concluded:
            return last.position, ZERO, ZERO
        found = self._moving.at(self._places, self._version, now_ns)
        return cast(Vector3, found.value), found.rate, found.change

    def end(self, now_ns: int) -> tuple[Target, float] | None:
        """Return the target that is known to be the last, and the time until then, s.

        ``None`` once its time has come: from then on it is the only one.
        """
        if not self._targets or self._is_concluded:
            return None
        newest = self._targets[-1]
        left_ns = newest.time_ns - now_ns
        if left_ns <= 0:
            return None
        omega = newest.omega_body
        is_end = self._arrivals.have_ceased(now_ns) if omega is None else omega == ZERO
        return (newest, left_ns * 1e-9) if is_end else None

    def conclude(self) -> None:
        """Make the last target an order to be there from now on, until another one arrives."""
        self._is_concluded = True

    @property
    def begins(self) -> bool:
        """Whether the newest target whose time has come begins a motion."""
        return self.last is not None and self.last.time_ns == self._turning.begin_ns

    def _at_rest(self, newest: Target) -> ReferenceState:
        """Return the newest target as an order to be there."""
        self.last = newest
        return ReferenceState(newest.q, ZERO, ZERO)

    def _delay_by(self, stale_ns: float) -> None:
        """Follow how old targets are."""
        period_ns, last_ns = self._period_ns, self._delay_ns
        least_ns = max(min(SPARE * stale_ns, LONGEST_DELAY_NS), last_ns - RECOVERY * period_ns, 0.0)
        self._delay_ns = min(least_ns, last_ns + GROWTH * period_ns)


def _problem_of(target: Target, now_ns: int) -> str:
    """Return what is wrong with a target by itself, or an empty string."""
    q, omega, time_ns, expires_ns, position = target
    size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    if not abs(size - 1.0) <= 2.0 * NORM_TOLERANCE:
        return f"expected a unit quaternion, got {q}"
    if omega is not None and not all(abs(x) <= LARGEST for x in omega):
        return f"expected an angular velocity within {LARGEST:g} rad/s, got {omega}"
    if position is not None and not all(abs(x) <= LARGEST for x in position):
        return f"expected a position within {LARGEST:g} m, got {position}"
    if time_ns > now_ns + LOOKAHEAD_NS:
        most = LOOKAHEAD_NS // 1_000_000_000
        return f"stamped {(time_ns - now_ns) / 1e9:.6g} s ahead, the most is {most} s"
    return "expired" if expires_ns <= max(now_ns, time_ns) else ""


def _lies_between(before: Target, target: Target, after: Target) -> bool:
    """Whether a target lies between two others, or nearly."""
    way = norm(difference(before.q, target.q)) + norm(difference(target.q, after.q))
    if way > norm(difference(before.q, after.q)) + AGREEING:
        return False
    a, b, c = before.position, target.position, after.position
    if a is None or b is None or c is None:
        return a is b is c
    return dist(a, b) + dist(b, c) <= dist(a, c) + AGREEING
