"""Targets, and the smooth motion that they describe together.

The sender's time stamps count, not the arrival times.  Between moving targets the velocity changes
linearly.  The network decides which targets have arrived, so the reference must not depend on that.
It is therefore read with a delay, a little longer than targets have lately been late.  From there
it is extrapolated to now with its velocity and its average acceleration.  A motion of constant
velocity or acceleration is followed without lag; a change of the acceleration shows late.
Extrapolation amplifies some frequencies.  Here these are above those of a hand's motion.  If a
target arrives after a newer one, it is inserted as long as the reference has not been read there.
If the sender stamps targets ahead by more than its jitter, there is no delay.

A target at rest is an order to be there.  It counts at once and is not joined to others.  So does a
target far from the prediction of the previous one.  A target without velocity gets the velocity of
the previous ones, until the next one is overdue.  Then it becomes an order too.

A target that arrives later replaces all waiting ones from its stamp on.  A target that is only
late, as networks make them, lies between its neighbours and is inserted.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from math import dist, inf

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, difference, exp, multiply, norm, normalize, plus
from orientd.servo.tracking.targets import (
    BENT,
    FilteredTarget,
    ReferenceState,
    Target,
    carried_on,
    continued,
    filtered,
    joined,
)
from orientd.tolerances import NORM_TOLERANCE

LOOKAHEAD_NS = 10_000_000_000
"""How far ahead of its time a target may arrive."""

CAPACITY = 10_000
"""Most waiting targets: one per millisecond."""

FILTERED_AT_ONCE = 16
"""Most targets that are filtered in a cycle, the earliest ones first.

A late target changes all after it.  It is more than arrive in a cycle, so those whose time has come
are always filtered.
"""

AGREEING = 5e-3
"""How much longer the path through a late target may be than between its neighbours, rad or m."""

LARGEST = 1000.0
"""Largest plausible component of an angular velocity or a position, rad/s or m."""

LONGEST_DELAY_NS = 150_000_000
"""Age beyond which targets are extrapolated without regard to later ones."""

GROWTH = 0.1
"""Growth of the delay when targets are later than ever, seconds per second."""

RECOVERY = 0.01
"""Decrease of the delay, seconds per second."""

SPARE = 1.3
"""Delay of reading the reference, in multiples of the lateness of targets."""

STEADY = 0.04
"""Least averaging time of the acceleration for the extrapolation, s."""

STEADIER = 1.2
"""The same averaging time in multiples of the delay."""

SETTLING = 0.008
"""Time in which the law follows an acceleration, s."""

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
        self._period_ns = period * 1e9
        self.clear()

    @property
    def delay(self) -> float:
        """Delay of reading the motion, s."""
        return self._delay_ns * 1e-9

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
        # Targets from this index on are unfiltered: they have arrived, or follow one that has.
        self._unfiltered = 0
        self._targets: deque[FilteredTarget] = deque()
        self._arrivals = Arrivals(self._period_ns)
        self._delay_ns = 0.0
        self._mean_alpha = ZERO
        self._newest_ns: int | None = None
        self._is_concluded = False
        self.last: FilteredTarget | None = None

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
            place = bisect_left(targets, time_ns, key=_time_of)
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
        targets.insert(place, FilteredTarget(target, target.q, ZERO, ZERO, begins=True))
        self._unfiltered = min(self._unfiltered, place)
        return ""

    def _make_way(self, target: Target, place: int, newest_ns: int) -> None:
        """Drop the targets that *target*, stamped before the newest one, replaces."""
        targets, time_ns = self._targets, target.time_ns
        if newest_ns - time_ns <= LONGEST_DELAY_NS and 0 < place < len(targets):
            before, after = targets[place - 1].target, targets[place].target
            if _lies_between(before, target, after):
                if after.time_ns - time_ns < self._period_ns:
                    del targets[place]
                return
        while len(targets) > place:
            targets.pop()
        self._newest_ns = time_ns

    def _has_room(self, time_ns: int, place: int, now_ns: int) -> bool:
        """Whether a late target can be inserted: the motion has not been read there."""
        targets = self._targets
        is_read = place == 0 or time_ns <= now_ns - self._delay_ns
        return not is_read and (place == len(targets) or targets[place].target.time_ns > time_ns)

    def at(self, now_ns: int) -> ReferenceState | None:
        """Return the motion at *now_ns*, or ``None`` without a live target."""
        targets = self._targets
        count, end = len(targets), min(len(targets), self._unfiltered + FILTERED_AT_ONCE)
        for k in range(self._unfiltered, end):
            targets[k] = filtered(targets[k - 1] if k else None, targets[k].target)
        motion = self._read(now_ns)
        self._unfiltered = max(0, end - (count - len(targets)))
        return motion

    def position_at(self, now_ns: int) -> tuple[Vector3, Vector3, Vector3] | None:
        """Return position, velocity and acceleration of the target at *now_ns*, if it has any.

        Call it after :meth:`at` for the same time.  The units are m and s.
        """
        last = self.last
        if last is None or last.travelling is None or last.target.position is None:
            return None
        is_end = last is self._targets[-1] and self._arrivals.have_ceased(now_ns)
        if is_end or self._is_concluded:
            return last.target.position, ZERO, ZERO
        found, since = last.travelling, (now_ns - last.target.time_ns) * 1e-9
        way, velocity = carried_on(found.velocity, found.acceleration, since)
        acceleration = found.acceleration if since < BENT else ZERO
        return plus(last.position, way, 1.0), velocity, acceleration

    def end(self, now_ns: int) -> tuple[Target, float] | None:
        """Return the target that is known to be the last, and the time until then, s.

        ``None`` once its time has come: from then on it is the only one.
        """
        if not self._targets or self._is_concluded:
            return None
        newest = self._targets[-1]
        left_ns = newest.target.time_ns - now_ns
        if left_ns <= 0:
            return None
        omega = newest.target.omega_body
        is_end = self._arrivals.have_ceased(now_ns) if omega is None else omega == ZERO
        return (newest.target, left_ns * 1e-9) if is_end else None

    def conclude(self) -> None:
        """Make the last target an order to be there from now on, until another one arrives."""
        self._is_concluded = True

    def _read(self, now_ns: int) -> ReferenceState | None:
        targets = self._targets
        self.last = None
        if self._is_concluded and targets and now_ns < targets[-1].target.expires_ns:
            return self._at_rest(targets[-1])
        due, first = -1, 0
        for k, each in enumerate(targets):
            if each.target.time_ns > now_ns:
                break
            due = k
            if each.begins:
                first = k
        if due < 0:
            return None
        if now_ns >= targets[due].target.expires_ns:
            for _ in range(due + 1):
                targets.popleft()
            self._delay_ns = 0.0
            self._mean_alpha = ZERO
            return None
        self.last = targets[due]
        for _ in range(first):
            targets.popleft()
        newest = targets[-1]
        stale_ns = now_ns - newest.target.time_ns
        is_open = newest.target.omega_body is None
        if is_open and stale_ns >= 0 and self._arrivals.have_ceased(now_ns):
            return self._at_rest(newest)
        delay_ns = self._delay_by(stale_ns)
        while (
            len(targets) > 1
            and targets[1].target.time_ns <= now_ns - delay_ns
            and not targets[1].begins
        ):
            targets.popleft()
        here = targets[0]
        since = (now_ns - here.target.time_ns) * 1e-9
        ahead = delay_ns * 1e-9
        if here.begins and since <= ahead:
            self._mean_alpha = ZERO
            found = continued(here, since)
            return ReferenceState(normalize(found.q), found.omega, ZERO)
        since = max(since - ahead, 0.0)
        if len(targets) == 1 or targets[1].begins:
            past = continued(here, since)
        else:
            past = joined(here, targets[1], since)
        return self._carried(past, ahead)

    def _at_rest(self, newest: FilteredTarget) -> ReferenceState:
        """Return the newest target as an order to be there."""
        self.last, self._mean_alpha = newest, ZERO
        return ReferenceState(newest.target.q, ZERO, ZERO)

    def _delay_by(self, stale_ns: float) -> float:
        """Choose the delay at which the motion is read, and return it, ns."""
        period_ns, last_ns = self._period_ns, self._delay_ns
        least_ns = max(min(SPARE * stale_ns, LONGEST_DELAY_NS), last_ns - RECOVERY * period_ns, 0.0)
        self._delay_ns = delay_ns = min(least_ns, last_ns + GROWTH * period_ns)
        return delay_ns

    def _carried(self, past: ReferenceState, ahead: float) -> ReferenceState:
        """Return the motion *ahead* (s) of the read one."""
        mean, period = self._mean_alpha, self._period_ns * 1e-9
        share = period / max(STEADY, STEADIER * ahead)
        change = combine(past.alpha, share, mean, -share)
        self._mean_alpha = mean = plus(mean, change, 1.0)
        half = 0.5 * ahead * ahead
        turn = combine(past.omega, ahead, mean, half)
        # The derivative of that, with the velocity and the average both changing.
        omega = plus(plus(past.omega, past.alpha, ahead), change, half / period)
        # It also lags by the time in which the law follows an acceleration.
        lead = 0.0 if self.is_disturbed else (ahead + SETTLING) / period
        q = normalize(multiply(past.q, exp(turn)))
        return ReferenceState(q, omega, past.alpha, plus(ZERO, change, lead))


def _time_of(filtered_target: FilteredTarget) -> int:
    return filtered_target.target.time_ns


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
