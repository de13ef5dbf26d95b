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

A target at rest is an order to be there: it counts at once and is not joined to others; so does one
that is far from what the one before it predicts.  One without velocity has the velocity that those
before it tell of, until the next one is overdue; then it is an order, too.

What arrives later counts: a target replaces everything that waits from its stamp on.  One that is
only late, by no more than networks make of it, lies between its neighbours and is put in its place.
"""

from __future__ import annotations

from collections import deque
from math import dist

from orientd.driver import ZERO, Vector3
from orientd.floats import difference, exp, multiply, norm, normalize
from orientd.servo.tracking.knot import (
    Knot,
    ReferenceState,
    Target,
    believed,
    continued,
    joined,
    knot_of,
    place_of,
)
from orientd.tolerances import NORM_TOLERANCE

LOOKAHEAD_NS = 10_000_000_000
"""How far ahead of its time a target may come."""

SORTED = 16
"""A target that comes late is put in its place before so many others at most."""

CAPACITY = 10_000
"""Targets that wait for their time, at most: one a millisecond."""

AGREEING = 5e-3
"""By how much longer the way by a late target may be than between its neighbours, rad or m."""

FASTEST = 1000.0
"""Largest angular velocity believed of a target, rad/s, per component."""

FARTHEST = 1000.0
"""Largest component of a position, m."""

SILENT = 4.0
"""After how many times the usual gap between arrivals, and :data:`SILENT_NS` more, targets without
velocity are taken to have ceased where some are lost or late; where none is, the next one is
overdue from :data:`DISTURBED` times the usual gap on."""

SILENT_NS = 50_000_000

PAUSE_NS = 250_000_000
"""What comes so long after the time of the newest target begins anew, and tells of no usual gap."""

LONGEST_DELAY_NS = 150_000_000
"""How stale targets may become before they are carried on without regard to their successors."""

GROWTH = 0.1
"""How fast the delay grows when targets are staler than ever, seconds per second."""

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


class Reference:
    """The motion that the targets describe."""

    def __init__(self, period: float) -> None:
        """Expect to be asked every *period* seconds."""
        self._period_ns = period * 1e9
        self._growth_ns = GROWTH * period * 1e9
        self._recovery_ns = RECOVERY * period * 1e9
        self._knots: deque[Knot] = deque()
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
        self._arrived_ns = 0
        self._gap_ns = self._longest_gap_ns = 0.0
        self._is_concluded = False
        self.last: Knot | None = None

    def take(self, target: Target, now_ns: int) -> str:
        """Take a target.

        Returns:
            An empty string, or why it was refused.
        """
        q, omega, time_ns, expires_ns, position = target
        size = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
        if not abs(size - 1.0) <= 2.0 * NORM_TOLERANCE:
            return f"expected a unit quaternion, got {q}"
        if omega is not None and not all(abs(x) <= FASTEST for x in omega):
            return f"expected an angular velocity within {FASTEST:g} rad/s, got {omega}"
        if position is not None and not all(abs(x) <= FARTHEST for x in position):
            return f"expected a position within {FARTHEST:g} m, got {position}"
        if time_ns > now_ns + LOOKAHEAD_NS:
            most = LOOKAHEAD_NS // 1_000_000_000
            return f"stamped {(time_ns - now_ns) / 1e9:.6g} s ahead, the most is {most} s"
        if expires_ns <= now_ns or expires_ns <= time_ns:
            return "expired"
        knots, place, newest_ns = self._knots, len(self._knots), self._newest_ns
        if newest_ns is not None and time_ns <= newest_ns:
            if time_ns > now_ns - 2.0 * self._period_ns:
                place = self._make_way(target, newest_ns)
            else:
                place = self._place(time_ns, now_ns)
                if place == 0:
                    late = (newest_ns - time_ns) / 1e9
                    return f"not newer than the newest one, {late:.6g} s older, nor to be sorted in"
        elif len(knots) >= CAPACITY:
            return f"{CAPACITY} targets wait already"
        self._note_arrival(now_ns)
        if self._newest_ns is None or time_ns > self._newest_ns:
            self._note_spacing(time_ns)
        self._note_age(now_ns - time_ns)
        self._taken += 1
        knots.insert(place, knot_of(target))
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

    def _note_arrival(self, now_ns: int) -> None:
        """Note how far apart targets arrive; those that come together count as one."""
        gap_ns = now_ns - self._arrived_ns
        self._arrived_ns, self._is_concluded = now_ns, False
        if self._newest_ns is None or gap_ns <= 0:
            return
        if now_ns - self._newest_ns > max(PAUSE_NS, SILENT * self._gap_ns + SILENT_NS):
            return
        share = USUAL if self._gap_ns else 1.0
        self._gap_ns += share * (gap_ns - self._gap_ns)
        self._longest_gap_ns = max(gap_ns, self._longest_gap_ns - RECOVERY * gap_ns)

    def _make_way(self, target: Target, newest_ns: int) -> int:
        """Drop what *target*, stamped before the newest one, replaces; return its place."""
        knots, time_ns = self._knots, target.time_ns
        if newest_ns - time_ns <= LONGEST_DELAY_NS:
            place = len(knots)
            while place and knots[place - 1].time_ns >= time_ns:
                place -= 1
            if 0 < place < len(knots) and _lies_between(knots[place - 1], target, knots[place]):
                if knots[place].time_ns - time_ns < self._period_ns:
                    del knots[place]
                return place
        while knots and knots[-1].time_ns >= time_ns:
            knots.pop()
        self._newest_ns, self._taken = time_ns, 0
        return len(knots)

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
            knots[k] = believed(knots[k - 1] if k else None, knots[k])
        self._settled = len(knots)

    @property
    def awaits(self) -> bool:
        """Whether there is a target whose time has not passed."""
        return bool(self._knots)

    def at(self, now_ns: int) -> ReferenceState | None:
        """Return the motion at *now_ns*, or ``None`` without a live target."""
        if self._settled < len(self._knots):
            self._settle()
        motion = self._read(now_ns)
        self._settled = len(self._knots)
        return motion

    def position_at(self, now_ns: int) -> tuple[Vector3, Vector3] | None:
        """Return position and velocity of the target at *now_ns*, m and m/s, if it has any.

        To be asked after :meth:`at` for the same instant.
        """
        knot = self.last
        if knot is None:
            return None
        is_end = knot is self._knots[-1] and self._has_ceased(now_ns)
        if knot.told_position is not None and (is_end or self._is_concluded):
            return knot.told_position, ZERO
        return place_of(knot, (now_ns - knot.time_ns) * 1e-9)

    def end(self, now_ns: int) -> tuple[Knot, float] | None:
        """Return the target that is known to be the last, and the time left to it, s.

        ``None`` once its time has come: from then on it is the only one there is.
        """
        if not self._knots or self._is_concluded:
            return None
        newest = self._knots[-1]
        if newest.time_ns <= now_ns:
            return None
        is_end = newest.omega == ZERO if newest.estimate is None else self._has_ceased(now_ns)
        return (newest, (newest.time_ns - now_ns) * 1e-9) if is_end else None

    def conclude(self) -> None:
        """Let the last target be an order to be there from now on, until another one comes."""
        self._is_concluded = True

    def _has_ceased(self, now_ns: int) -> bool:
        """Whether the next target is overdue."""
        patience_ns = DISTURBED * self._gap_ns + 2.0 * self._period_ns
        if self._longest_gap_ns > patience_ns:
            patience_ns = SILENT * self._gap_ns + SILENT_NS
        return now_ns - self._arrived_ns > patience_ns

    def _read(self, now_ns: int) -> ReferenceState | None:
        knots = self._knots
        self.last = None
        if self._is_concluded and knots and now_ns < knots[-1].expires_ns:
            self.last = knots[-1]
            self._bend = ZERO
            return ReferenceState(self.last.told, ZERO, ZERO)
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
        self.last = knots[due]
        for _ in range(first):
            knots.popleft()
        stale_ns = now_ns - knots[-1].time_ns
        newest = knots[-1]
        if newest.estimate is not None and stale_ns >= 0 and self._has_ceased(now_ns):
            self._bend = ZERO
            return ReferenceState(newest.told, ZERO, ZERO)
        self._stalest_ns = max(self._stalest_ns - self._recovery_ns, stale_ns)
        last_ns, wished_ns = self._delay_ns, min(SPARE * stale_ns, LONGEST_DELAY_NS)
        delay_ns = min(max(wished_ns, last_ns - self._recovery_ns, 0.0), last_ns + self._growth_ns)
        self._delay_ns = delay_ns
        while len(knots) > 1 and knots[1].time_ns <= now_ns - delay_ns and not knots[1].begins:
            knots.popleft()
        here = knots[0]
        since = (now_ns - here.time_ns) * 1e-9
        ahead = delay_ns * 1e-9
        if here.begins and since <= ahead:
            self._bend = ZERO
            return ReferenceState(normalize(here.carried(since)), here.omega, ZERO)
        since = max(since - ahead, 0.0)
        if len(knots) == 1 or knots[1].begins:
            past = continued(here, since)
        else:
            missing_ns = knots[1].time_ns - here.time_ns - BRIDGE * self._spacing_ns
            if missing_ns > 0.0:
                self._stalest_ns = max(self._stalest_ns, self._explained_ns + missing_ns)
            past = joined(here, knots[1], since)
        # What was read a cycle ago was read from a little less or more than a cycle before.
        return self._carried(past, ahead, 1.0 - (delay_ns - last_ns) / self._period_ns)

    def _carried(self, past: ReferenceState, ahead: float, pace: float) -> ReferenceState:
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
        return ReferenceState(normalize(multiply(q, exp(turn))), omega, past.alpha, swing)


def _lies_between(before: Knot, target: Target, after: Knot) -> bool:
    """Whether a target lies on the way from one knot to another, or nearly."""
    told = normalize(target.q)
    way = norm(difference(before.told, told)) + norm(difference(told, after.told))
    if way > norm(difference(before.told, after.told)) + AGREEING:
        return False
    a, b, c = before.told_position, target.position, after.told_position
    if a is None or b is None or c is None:
        return a is b is c
    return dist(a, b) + dist(b, c) <= dist(a, c) + AGREEING
