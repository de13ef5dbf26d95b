"""The reference of chunks: poses that are known ahead, and the seams between chunks.

A chunk is a curve through its poses (:mod:`orientd.servo.tracking.chunks`).  It replaces everything
from its first live pose on; poses whose time has passed only shape the curve.  The seam is one
quintic.  It begins at the last setpoint, or at the last pose that is left of the chunk before.  It
ends at the first knot that it can reach within the limits.  So the reference is continuous up to
the acceleration, and equal to the last setpoint after every chunk.

If no knot can be reached so, the curve of the chunk is the reference without a seam.  The tracker
closes in on it as soon as the limits allow.  Later chunks begin seams at the last setpoint again.

The motion of the next cycle is known, so it is fed forward as the difference that the guard will
see.  The device follows without lag as long as the limits allow.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, dot, norm, plus
from orientd.servo.tracking.law import Law
from orientd.servo.tracking.quintic import Knot, Piece, Quintic
from orientd.servo.tracking.reference import Arrivals
from orientd.stream.records import ServoLimits

BRIDGE_NS = 100_000_000
"""How long a seam takes at least, if the chunk reaches so far.  Two chunks of one policy differ by
its noise, and the acceleration for a gap falls with the square of this time."""

SHARE = 0.95
"""Part of the limits that a seam uses, so that some is left to follow it."""

AGREEING = 0.02
"""Up to which gap, rad or m, a chunk is where a seam under way leads.  Then that seam stays as it
is: if every chunk began it again, a long one would never end."""

CATCHING_UP = 0.01
"""Part of a shift of the deadlines that the reading of the curve makes up for in one cycle."""

REMEMBERED = 1.0
"""How long a gap to the reference counts for the lag, s."""

STANDING, STANDING_PLACE = 0.01, 0.001
"""Speed of the reference up to which a gap to it is no lag, rad/s and m/s: noise of poses."""

LONGEST_LAG = 60.0
"""Largest lag that is reported, s: no pose of a chunk is farther ahead."""

_LOOKS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Where a seam is held against the limits."""


class Motion(NamedTuple):
    """Orientation and position at a setpoint, and backward differences as the guard has them.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity of the last step, rad/s.
        alpha: angular acceleration of the last two steps, rad/s^2.
        position: m.
        velocity: of the last step, m/s.
        acceleration: of the last two steps, m/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    position: Vector3
    velocity: Vector3
    acceleration: Vector3


class PreviewState(NamedTuple):
    """The reference at the last setpoint, as a :class:`Motion`, and how it continues.

    Attributes:
        q: orientation.
        omega: rad/s.
        alpha: rad/s^2.
        position: m.
        velocity: m/s.
        acceleration: m/s^2.
        next_alpha: angular acceleration with the next step, rad/s^2.
        next_acceleration: acceleration with the next step, m/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    position: Vector3
    velocity: Vector3
    acceleration: Vector3
    next_alpha: Vector3
    next_acceleration: Vector3


class Lag:
    """The delay of the setpoints behind the reference that fits the last second best.

    Attributes:
        seconds: that delay, s; 0 if the reference stands still.
    """

    def __init__(self, period: float, standing: float) -> None:
        """Know no gap yet; a reference no faster than *standing*, rad/s or m/s, stands still."""
        self._kept, self._standing = 1.0 - period / REMEMBERED, standing
        self._slipped = self._swept = self.seconds = 0.0

    def note(self, gap: Vector3, rate: Vector3) -> None:
        """Note the way from a setpoint to the reference, rad or m, and the rate of that."""
        if norm(rate) <= self._standing:
            rate = ZERO
        self._slipped = self._kept * self._slipped + dot(gap, rate)
        self._swept = self._kept * self._swept + dot(rate, rate)
        lag = self._slipped / self._swept if self._swept > 0.0 else 0.0
        self.seconds = min(max(lag, 0.0), LONGEST_LAG)


class Preview:
    """The curve of the chunks that have come.

    Attributes:
        has_positions: whether the newest chunk says where to be.
        live: poses of the newest chunk that were still to come when it arrived.
        stale: poses of all chunks that were not.
        seam: largest angle by which a chunk contradicted the one before, rad: at its first live
            pose.
        least_left_ns: least time that was left of a chunk when the next one came.
        starved: how many chunks came after the poses had run out, with poses to come or without.
        lag: delay of the orientation.
        position_lag: delay of the position.
    """

    def __init__(self, period: float, servo_limits: ServoLimits) -> None:
        """Know nothing yet; seams keep *servo_limits*, for one setpoint per *period* seconds."""
        self._period = period
        self._period_ns = round(period * 1e9)
        self._turning, self._moving = Law(period), Law(period)
        self._turning.limit_turn(servo_limits)
        self._moving.limit_position(servo_limits)
        self.clear()

    def clear(self) -> None:
        """Forget every chunk."""
        self._knots: list[Knot] = []
        self._piece: Piece | None = None
        self._state: Motion | None = None
        self._joins: Knot | None = None
        self._read_ns = 0
        self._arrivals = Arrivals(1e9 * self._period)
        self.has_positions = False
        self.live = self.stale = self.starved = 0
        self.least_left_ns: int | None = None
        self.seam = 0.0
        self.lag = Lag(self._period, STANDING)
        self.position_lag = Lag(self._period, STANDING_PLACE)

    @property
    def is_on(self) -> bool:
        """Whether there is a chunk."""
        return bool(self._knots)

    @property
    def end(self) -> Knot:
        """The last pose."""
        return self._knots[-1]

    def is_continued(self, now_ns: int) -> bool:
        """Whether the next chunk is expected before the poses run out, and not overdue."""
        arrivals = self._arrivals
        return arrivals.next_ns <= self.end.time_ns and not arrivals.have_ceased(now_ns)

    def take(
        self,
        knots: Sequence[Knot],
        sent: Motion,
        sent_ns: int,
        *,
        has_positions: bool,
        is_fresh: bool,
    ) -> str:
        """Take a chunk.

        Args:
            knots: its curve, times ascending.
            sent: the last setpoint.
            sent_ns: the time of that.
            has_positions: whether the chunk says where to be.
            is_fresh: whether nothing is left of the curve before, or the device is not on it.

        Returns:
            An empty string, or why the chunk is refused: all of it has passed.
        """
        first = bisect_right(knots, sent_ns, key=_time_of)
        self.stale += first
        if first == len(knots):
            self.starved += not self._knots or self.end.time_ns <= sent_ns
            return "every pose of the chunk has passed"
        self._arrivals.note(self.end.time_ns if self._knots else None, sent_ns)
        given = knots[max(first - 1, 0) :]
        knots = [self._eased(knot) for knot in knots[first:]]
        self.live = len(knots)
        self._compare(knots[0], sent, sent_ns)
        kept: list[Knot] = []
        if self._knots and not is_fresh and has_positions == self.has_positions:
            kept = self._kept(self._left_ns(knots), sent_ns)
        self.has_positions = has_positions
        start = kept.pop() if kept else self._knot_of(sent, sent_ns)
        excess, piece = self._seam(start, knots)
        if excess > 1.0 and len(given) > len(knots):
            self._knots = list(given)
            self._piece = self._joins = None
            self._state, self._read_ns = self._motion_at(sent_ns), sent_ns
            return ""
        if not kept:
            self._state, self._read_ns = sent, sent_ns
        self._joins = piece.there
        after = bisect_right(knots, piece.there.time_ns, key=_time_of)
        self._knots = [*kept, start, piece.there, *knots[after:]]
        self._piece = None if kept else piece
        return ""

    def _knot_of(self, sent: Motion, sent_ns: int) -> Knot:
        """Return a setpoint as a knot, with the derivatives at its instant."""
        half = 0.5 * self._period
        velocity = plus(sent.velocity, sent.acceleration, half)
        omega = plus(sent.omega, sent.alpha, half)
        return Knot(sent_ns, sent.q, omega, sent.alpha, sent.position, velocity, sent.acceleration)

    def _eased(self, knot: Knot) -> Knot:
        """Return a knot no faster than the limits: a curve through an outlier swings less."""
        speed, change = (self._turning.share(k, v) for k, v in enumerate((knot.omega, knot.alpha)))
        if max(speed, change) <= 1.0:
            return knot
        return knot._replace(
            omega=plus(ZERO, knot.omega, 1.0 / max(speed, 1.0)),
            alpha=plus(ZERO, knot.alpha, 1.0 / max(change, 1.0)),
        )

    def _compare(self, knot: Knot, sent: Motion, sent_ns: int) -> None:
        """Note by how much a chunk contradicts the one before, and how late it comes."""
        if not self._knots:
            return
        left_ns = self.end.time_ns - sent_ns
        if self.least_left_ns is None or left_ns < self.least_left_ns:
            self.least_left_ns = left_ns
        if left_ns <= 0:
            self.starved += 1
        q = sent.q if left_ns <= 0 else self._pose_at(knot.time_ns)[0]
        self.seam = max(self.seam, norm(difference(q, knot.q)))

    def _left_ns(self, knots: Sequence[Knot]) -> int:
        """Return until when the old curve stays: to the end of its seam if *knots* go by there."""
        until_ns, joins = knots[0].time_ns - BRIDGE_NS, self._joins
        if joins is None or not knots[0].time_ns <= joins.time_ns < knots[-1].time_ns:
            return until_ns
        place = bisect_right(knots, joins.time_ns, key=_time_of)
        piece = Piece(knots[place - 1], knots[place])
        (q, at), (q1, at1) = piece.at(joins.time_ns), piece.at(joins.time_ns + 1_000_000)
        omega, bridge = plus(ZERO, difference(q, q1), 1e3), 1e-9 * BRIDGE_NS
        gap = norm(difference(q, joins.q)) + bridge * norm(plus(omega, joins.omega, -1.0))
        away = 0.0
        if self.has_positions:
            velocity = combine(at1, 1e3, at, -1e3)
            away = norm(plus(at, joins.position, -1.0))
            away += bridge * norm(plus(velocity, joins.velocity, -1.0))
        return joins.time_ns if max(gap, away) < AGREEING else until_ns

    def _kept(self, until_ns: int, sent_ns: int) -> list[Knot]:
        """Return the knots that stay of the old curve before *until_ns*, from that before now on.

        Empty if none of them is still to come: the seam begins at what was sent then.
        """
        knots = self._knots
        begin = max(bisect_right(knots, sent_ns, key=_time_of) - 1, 0)
        end = bisect_right(knots, until_ns, key=_time_of)
        return knots[begin:end] if end - begin > 1 else []

    def _seam(self, start: Knot, knots: Sequence[Knot]) -> tuple[float, Piece]:
        """Return the piece from *start* to the first knot from which on the limits are kept.

        The number before it says how many times it needs a limit; if that is above 1, no piece
        keeps the limits, and this one needs least.
        """
        earliest_ns = start.time_ns + BRIDGE_NS
        place = min(bisect_right(knots, earliest_ns - 1, key=_time_of), len(knots) - 1)
        found: tuple[float, Piece] | None = None
        for knot in knots[place:]:
            piece = Piece(start, knot)
            excess = self._excess(piece)
            if found is None or excess < found[0]:
                found = excess, piece
            if excess <= 1.0:
                break
        if found is None:
            raise ValueError("a chunk has at least one pose")
        return found

    def _excess(self, piece: Piece) -> float:
        """Return how many times a seam needs what it may use of any limit."""
        excess = 0.0
        for u in _LOOKS:
            excess = max(excess, _need(self._turning, piece.turn, u, piece.span))
            if self.has_positions:
                excess = max(excess, _need(self._moving, piece.way, u, piece.span))
        return excess

    def _piece_at(self, time_ns: int) -> Piece:
        """Return the piece of the curve at an instant, or the first or last one beyond its ends."""
        piece, knots = self._piece, self._knots
        if piece is not None and piece.here.time_ns <= time_ns < piece.there.time_ns:
            return piece
        place = bisect_right(knots, time_ns, key=_time_of)
        place = min(max(place, 1), len(knots) - 1)
        return Piece(knots[place - 1], knots[place])

    def _pose_at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return orientation and position of the curve at an instant; the last ones after it."""
        end = self.end
        if time_ns >= end.time_ns:
            return end.q, end.position
        piece = self._piece_at(time_ns)
        if time_ns < self._read_ns + 2 * self._period_ns:
            self._piece = piece
        return piece.at(time_ns)

    def at(self, now_ns: int) -> PreviewState:
        """Return the reference at the setpoint before *now_ns*, and how it continues to there.

        To be asked once for every setpoint, in order.
        """
        before, h = self._state, self._period
        if before is None:
            raise ValueError("no chunk has come")
        # The guard takes every cycle for a period, and deadlines may shift a little.
        late_ns = now_ns - self._read_ns - self._period_ns
        if abs(late_ns) > self._period_ns:
            before, self._read_ns = self._motion_at(now_ns - self._period_ns), now_ns
        else:
            self._read_ns += self._period_ns + round(CATCHING_UP * late_ns)
        q, position = self._pose_at(self._read_ns)
        omega = plus(ZERO, difference(before.q, q), 1.0 / h)
        alpha = combine(omega, 1.0 / h, before.omega, -1.0 / h)
        velocity = combine(position, 1.0 / h, before.position, -1.0 / h)
        acceleration = combine(velocity, 1.0 / h, before.velocity, -1.0 / h)
        self._state = Motion(q, omega, alpha, position, velocity, acceleration)
        return PreviewState(*before, alpha, acceleration)

    def _motion_at(self, time_ns: int) -> Motion:
        """Return the curve at an instant, with differences to the two periods before it."""
        h, step = self._period, self._period_ns
        (q0, p0), (q1, p1), (q2, p2) = (self._pose_at(time_ns - k * step) for k in (2, 1, 0))
        omega, velocity = (
            plus(ZERO, difference(q1, q2), 1.0 / h),
            combine(p2, 1.0 / h, p1, -1.0 / h),
        )
        alpha = combine(omega, 1.0 / h, difference(q0, q1), -1.0 / h / h)
        acceleration = combine(velocity, 1.0 / h, plus(p1, p0, -1.0), -1.0 / h / h)
        return Motion(q2, omega, alpha, p2, velocity, acceleration)


def _need(law: Law, way: Quintic, u: float, span: float) -> float:
    """Return how many times a way of *span* s needs at *u* what a seam may use of any limit."""
    velocity, acceleration, jerk = (
        law.share(k, rate) / span ** (k + 1) for k, rate in enumerate(way.derivatives(u))
    )
    return max(velocity / SHARE, acceleration / SHARE, jerk)


def _time_of(knot: Knot) -> int:
    return knot.time_ns
