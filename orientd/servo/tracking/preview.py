"""The reference of chunks: poses that are known ahead.

A chunk is a curve through its poses (:mod:`orientd.servo.tracking.chunks`).  It replaces everything
from its first live pose on; poses whose time has passed only shape the curve.  The motion before it
differs from the curve by an offset.  The offset fades as one quintic.  So the
reference is continuous up to the acceleration.  Later chunks continue the offset.  Only what they
change themselves can make it last longer.

If the offset cannot fade before the poses end, the curve itself is the reference.  The tracker
closes in on it as soon as the limits allow.

The motion of the next cycle is known, so it is fed forward as the difference that the guard will
see.  The device follows without lag as long as the limits allow.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, dot, exp, multiply, norm, plus
from orientd.servo.tracking.law import Law
from orientd.servo.tracking.quintic import Knot, Piece, quintic
from orientd.servo.tracking.reference import Arrivals
from orientd.stream.records import ServoLimits

BRIDGE_NS = 100_000_000
"""How long before its first pose a chunk takes over from the one before it."""

FADING = 0.15
"""How long an offset lasts at least, s.  Two chunks of one policy differ by its noise, and the
acceleration for a gap falls with the square of this time."""

SHARES = (0.55, 0.75, 0.95)
"""Parts of the limits that the poses and an offset may need together, in the order of trial."""

LONGER = 1.5
"""Factor between the spans of an offset that are tried in turn."""

CATCHING_UP = 0.01
"""Part of a shift of the deadlines that the reading of the curve makes up for in one cycle."""

REMEMBERED = 1.0
"""How long a gap to the reference counts for the lag, s."""

STANDING, STANDING_PLACE = 0.01, 0.001
"""Speed of the reference up to which a gap to it is no lag, rad/s and m/s: noise of poses."""

LONGEST_LAG = 60.0
"""Largest lag that is reported, s: no pose of a chunk is farther ahead."""


_NO_RATES = ((ZERO,) * 3, (ZERO,) * 3)


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
        self._waiting: list[Knot] = []
        self._piece: Piece | None = None
        self._offset: Offset | None = None
        self._state: Motion | None = None
        self._read_ns = self._switch_ns = 0
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
        return (self._waiting or self._knots)[-1]

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
        self.live = len(knots) - first
        self._compare(knots[first], sent, sent_ns)
        knots = list(knots[max(first - 1, 0) :])
        state = self._state
        if not self._knots or is_fresh or has_positions != self.has_positions or state is None:
            self._offset, state = None, sent
            self._read_ns = sent_ns
        self.has_positions = has_positions
        switch_ns = knots[0].time_ns - BRIDGE_NS
        if state is not sent and switch_ns > self._read_ns:
            # The curve before it stays until then, or to its end.
            self._waiting, self._switch_ns = knots, min(switch_ns, self._knots[-1].time_ns)
            return ""
        self._take_over(knots, state)
        return ""

    def _take_over(self, given: list[Knot], state: Motion) -> None:
        """Continue with a curve from *state*, where the reference has been read."""
        h, now_ns = self._period, self._read_ns
        old, self._offset, self._waiting, self._piece = self._offset, None, [], None
        knots = [self._eased(one) if one.time_ns > now_ns else one for one in given]
        if knots[0].time_ns > now_ns:
            piece = Piece(_knot_of(state, now_ns, h), knots[0])
            needs = (self._need(piece, 0.25 * k, _NO_RATES) for k in range(5))
            if knots[0].time_ns - now_ns >= BRIDGE_NS and max(needs) <= SHARES[-1]:
                self._knots, self._state = [piece.here, *knots], state
                return
            given, knots = ([_before(each[0], now_ns), *each] for each in (given, knots))
        self._knots = knots
        now = [self._bare_at(now_ns - k * self._period_ns) for k in (2, 1, 0)]
        pairs = list(zip(now, _past(state, h), strict=True))
        ways = [plus(b[1], a[1], -1.0) for a, b in pairs]
        offset = Offset([difference(a[0], b[0]) for a, b in pairs], ways, h, now_ns)
        if self._fades(offset, 0.0 if old is None else (old.end_ns - now_ns) * 1e-9):
            self._offset, self._state = offset, state
        else:
            self._knots, self._piece = given, None
            self._state = self._motion_at(now_ns)

    def _fades(self, offset: Offset, left: float) -> bool:
        """Choose in which time an offset fades; return whether there is one within the limits.

        The rest of the one before lasts *left* s; if the chunks agree, it keeps that time.
        """
        most = (self.end.time_ns - offset.begin_ns) * 1e-9
        spans = [FADING]
        while spans[-1] * LONGER < most:
            spans.append(spans[-1] * LONGER)
        trials = [(span, share) for share in SHARES for span in spans]
        if left > FADING:
            trials.insert(0, (left, SHARES[-1]))
        for span, share in trials:
            offset.last(span)
            if span < most and self._is_within(share, offset):
                return True
        return False

    def _is_within(self, share: float, offset: Offset) -> bool:
        """Return whether the curve with an offset needs at most a share of every limit."""
        for k in range(5):
            time_ns = offset.begin_ns + k * (offset.end_ns - offset.begin_ns - 1) // 4
            piece = self._piece_at(time_ns)
            u = (time_ns - piece.here.time_ns) * 1e-9 / piece.span
            if self._need(piece, u, offset.rates(time_ns)) > share:
                return False
        return True

    def _need(self, piece: Piece, u: float, more: Sequence[Sequence[Vector3]]) -> float:
        """Return the largest share of a limit that a piece needs at *u* with further rates."""
        parts = [(self._turning, piece.turn), (self._moving, piece.way)]
        need = 0.0
        for (law, way), others in zip(parts[: 1 + self.has_positions], more, strict=False):
            for k, (own, other) in enumerate(zip(way.derivatives(u), others, strict=True)):
                need = max(need, law.share(k, plus(other, own, piece.span ** -(k + 1))))
        return need

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
        q = sent.q if left_ns <= 0 else self._bare_at(knot.time_ns)[0]
        self.seam = max(self.seam, norm(difference(q, knot.q)))

    def _piece_at(self, time_ns: int) -> Piece:
        """Return the piece of the poses at an instant, or the first or last one beyond them."""
        knots, piece = self._knots, self._piece
        if piece is None or not piece.here.time_ns <= time_ns < piece.there.time_ns:
            place = bisect_right(knots, time_ns, key=_time_of)
            place = min(max(place, 1), len(knots) - 1)
            self._piece = piece = Piece(knots[place - 1], knots[place])
        return piece

    def _bare_at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return orientation and position of the poses at an instant; the last ones after it."""
        end = self._knots[-1]
        if time_ns >= end.time_ns:
            return end.q, end.position
        return self._piece_at(time_ns).at(time_ns)

    def _pose_at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return the same with the rest of the offset."""
        q, position = self._bare_at(time_ns)
        offset = self._offset
        if offset is None or time_ns >= offset.end_ns:
            return q, position
        turn, way = offset.at(time_ns)
        return multiply(q, exp(turn)), plus(position, way, 1.0)

    def at(self, now_ns: int) -> PreviewState:
        """Return the reference at the setpoint before *now_ns*, and how it continues to there.

        To be asked once for every setpoint, in order.
        """
        before, h = self._state, self._period
        if before is None:
            raise ValueError("no chunk has come")
        # The guard takes every cycle for a period, and deadlines may shift a little.
        if self._waiting and self._read_ns >= self._switch_ns:
            self._take_over(self._waiting, before)
            before = self._state or before
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


class Offset:
    """The rest of the motion before a chunk, relative to the curve of the chunk; it fades.

    Attributes:
        begin_ns: when it begins.
        end_ns: time from which it is nothing.
    """

    def __init__(
        self, turns: Sequence[Vector3], ways: Sequence[Vector3], h: float, begin_ns: int
    ) -> None:
        """Begin with the values of three successive setpoints, *h* s apart, at *begin_ns*."""
        self._begin = _differences(turns, h), _differences(ways, h)
        self.begin_ns = begin_ns
        self.last(FADING)

    def last(self, seconds: float) -> None:
        """Fade within *seconds*."""
        self._span = seconds
        self.end_ns = self.begin_ns + round(1e9 * seconds)
        self._fading = [
            quintic(
                plus(ZERO, gap, -1.0),
                plus(ZERO, rate, seconds),
                plus(ZERO, change, seconds * seconds),
                ZERO,
                ZERO,
            )
            for gap, rate, change in self._begin
        ]

    def at(self, time_ns: int) -> tuple[Vector3, Vector3]:
        """Return turn and displacement at an instant before its end."""
        u = (time_ns - self.begin_ns) * 1e-9 / self._span
        pairs = zip(self._begin, self._fading, strict=True)
        turn, way = (plus(begin[0], fading.value(u), 1.0) for begin, fading in pairs)
        return turn, way

    def rates(self, time_ns: int) -> list[list[Vector3]]:
        """Return the first three derivatives of turn and displacement at an instant."""
        u = (time_ns - self.begin_ns) * 1e-9 / self._span
        return [
            [plus(ZERO, rate, self._span ** -(k + 1)) for k, rate in enumerate(one.derivatives(u))]
            for one in self._fading
        ]


def _differences(values: Sequence[Vector3], h: float) -> tuple[Vector3, ...]:
    """Return the last of three values, and the first two derivatives there."""
    a, b, c = values
    rate = plus(combine(c, 1.5 / h, b, -2.0 / h), a, 0.5 / h)
    return c, rate, plus(combine(c, 1.0 / h / h, b, -2.0 / h / h), a, 1.0 / h / h)


def _past(state: Motion, h: float) -> list[tuple[Quaternion, Vector3]]:
    """Return the poses of a state, and of one and two cycles before it, the oldest first."""
    q, position, omega, velocity = state.q, state.position, state.omega, state.velocity
    poses = [(q, position)]
    for _ in range(2):
        q, position = multiply(q, exp(plus(ZERO, omega, -h))), plus(position, velocity, -h)
        poses.append((q, position))
        omega, velocity = plus(omega, state.alpha, -h), plus(velocity, state.acceleration, -h)
    return poses[::-1]


def _knot_of(state: Motion, time_ns: int, h: float) -> Knot:
    """Return a state as a knot, with the derivatives at its instant."""
    velocity = plus(state.velocity, state.acceleration, 0.5 * h)
    omega = plus(state.omega, state.alpha, 0.5 * h)
    at = state.position, velocity, state.acceleration
    return Knot(time_ns, state.q, omega, state.alpha, *at)


def _before(knot: Knot, time_ns: int) -> Knot:
    """Return where a motion of constant velocity to a knot is before that."""
    t = (time_ns - knot.time_ns) * 1e-9
    q = multiply(knot.q, exp(plus(ZERO, knot.omega, t)))
    return Knot(time_ns, q, knot.omega, ZERO, plus(knot.position, knot.velocity, t), knot.velocity)


def _time_of(knot: Knot) -> int:
    return knot.time_ns
