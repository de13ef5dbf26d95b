"""The reference of chunks: poses that are known ahead.

A chunk is a curve through its poses (:mod:`orientd.servo.tracking.chunks`).  It replaces everything
from its first live pose on; poses whose time has passed only shape the curve.  The motion before it
differs from the curve by an offset, which fades as one quintic.  So the reference is continuous up
to the acceleration.  A later chunk continues the offset, and adds only what it contradicts itself.
Chunks that agree add nothing.

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
from orientd.floats import combine, difference, exp, multiply, norm, plus
from orientd.servo.tracking.chunk_report import ChunkStatistics
from orientd.servo.tracking.chunks import Chunk
from orientd.servo.tracking.law import LEAST, Law
from orientd.servo.tracking.quintic import Knot, Piece, quintic, time_of
from orientd.servo.tracking.reference import Arrivals
from orientd.stream.records import ServoLimits

BRIDGE_NS = 100_000_000
"""How long before its first pose a chunk takes over from the one before it."""

FADING = 0.15
"""How long an offset lasts at least, s.  Two chunks of one policy differ by its noise, and the
acceleration for a gap falls with the square of this time."""

CALM = 0.6
"""Largest part of a limit that an offset may need, if the poses alone leave all of it free."""

LONGER = 1.4
"""Factor between the spans of an offset that are tried in turn."""

BENT = 0.05
"""Time for which the first acceleration of a curve is continued before its first pose, s."""

CATCHING_UP = 0.01
"""Part of a shift of the deadlines that the reading of the curve makes up for in one cycle."""

_LOOKS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Where a piece or an offset is held against the limits."""


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
    """Where the orientation should be at the last setpoint, and how it continues.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity of the last step, rad/s.
        alpha: angular acceleration of the last two steps, rad/s^2.
        next_alpha: with the next step, rad/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    next_alpha: Vector3


class Place(NamedTuple):
    """Where the position should be at the last setpoint, and how it continues.

    Attributes:
        position: m.
        velocity: of the last step, m/s.
        acceleration: of the last two steps, m/s^2.
        next_acceleration: with the next step, m/s^2.
    """

    position: Vector3
    velocity: Vector3
    acceleration: Vector3 = ZERO
    next_acceleration: Vector3 = ZERO


class Preview:
    """The curve of the chunks that have come.

    Attributes:
        has_positions: whether the newest chunk says where to be.
    """

    def __init__(
        self, period: float, servo_limits: ServoLimits, statistics: ChunkStatistics
    ) -> None:
        """Know nothing yet.

        Args:
            period: of a cycle, s.
            servo_limits: kept by offsets.
            statistics: told by how much chunks contradict, and from when on they count.
        """
        self._period, self._statistics = period, statistics
        self._period_ns = round(period * 1e9)
        self._turning, self._moving = Law(period), Law(period)
        self._turning.limit_turn(servo_limits)
        self._moving.limit_position(servo_limits)
        self.clear()

    def clear(self) -> None:
        """Forget every chunk."""
        self._knots: list[Knot] = []
        self._waiting: list[tuple[list[Knot], int]] = []
        self._piece: Piece | None = None
        self._offset: Offset | None = None
        self._state: Motion | None = None
        self._read_ns = 0
        self._arrivals = Arrivals(1e9 * self._period)
        self.has_positions = False

    @property
    def is_on(self) -> bool:
        """Whether there is a chunk."""
        return bool(self._knots)

    @property
    def end(self) -> Knot:
        """The last pose."""
        return self._newest[-1]

    @property
    def _newest(self) -> list[Knot]:
        """The curve of the newest chunk."""
        return self._waiting[-1][0] if self._waiting else self._knots

    def is_continued(self, now_ns: int) -> bool:
        """Whether the next chunk is expected before the poses run out, and not overdue."""
        arrivals = self._arrivals
        return arrivals.next_ns <= self.end.time_ns and not arrivals.have_ceased(now_ns)

    def take(self, chunk: Chunk, sent: Motion, sent_ns: int, *, is_fresh: bool) -> str:
        """Take a chunk.

        Args:
            chunk: its times ascend.
            sent: the last setpoint.
            sent_ns: the time of that.
            is_fresh: whether nothing is left of the curve before, or the device is not on it.

        Returns:
            An empty string, or why the chunk is refused: all of it has passed.
        """
        knots, has_positions, observed_ns = chunk
        first = bisect_right(knots, sent_ns, key=time_of)
        if first == len(knots):
            return "every pose of the chunk has passed"
        self._arrivals.note(self.end.time_ns if self._knots else None, sent_ns)
        self._compare(knots[first], sent, sent_ns)
        # The curve is read for the last three setpoints, too.
        begin = bisect_right(knots, sent_ns - 3 * self._period_ns, key=time_of)
        curve = list(knots[max(begin - 1, 0) :])
        is_fresh = is_fresh or not self._knots or has_positions != self.has_positions
        self.has_positions = has_positions
        if is_fresh:
            self._waiting, self._offset, self._read_ns = [], None, sent_ns
            self._take_over(curve, observed_ns, sent, _past(sent, self._period))
        else:
            # The curve before it stays until then, or to its end.
            first_ns = curve[0].time_ns
            self._waiting = [one for one in self._waiting if one[0][0].time_ns < first_ns]
            self._waiting.append((curve, observed_ns))
            self._take_over_if_due()
        return ""

    def _take_over_if_due(self) -> None:
        """Continue with the next curve if its first pose is due, or none is left before it."""
        while self._waiting and self._state is not None:
            due_ns = min(self._waiting[0][0][0].time_ns, self._knots[-1].time_ns)
            if due_ns > self._read_ns + self._period_ns:
                return
            before = [self._bare_at(time_ns) for time_ns in self._looks]
            self._take_over(*self._waiting.pop(0), self._state, before)

    @property
    def _looks(self) -> list[int]:
        """The times of the last three setpoints, the oldest first."""
        return [self._read_ns - k * self._period_ns for k in (2, 1, 0)]

    def _take_over(
        self,
        knots: list[Knot],
        observed_ns: int,
        state: Motion,
        before: Sequence[tuple[Quaternion, Vector3]],
    ) -> None:
        """Continue with a curve from *state*, where the reference has been read.

        Args:
            knots: the curve.
            observed_ns: the observation that it answers; 0 for none.
            state: the motion so far.
            before: poses of the curve before it at the last three setpoints.
        """
        h, now_ns = self._period, self._read_ns
        if observed_ns:
            self._statistics.note_action((now_ns - observed_ns) * 1e-9 + h)
        old, self._offset = self._offset, None
        given, knots = knots, [self._eased(one) if one.time_ns > now_ns else one for one in knots]
        self._knots, self._piece, self._state = knots, None, state
        if knots[0].time_ns - now_ns >= BRIDGE_NS:
            piece = Piece(_knot_of(state, now_ns, h), knots[0])
            if self._is_within(piece):
                self._knots = [piece.here, *knots]
                return
        bare = [self._bare_at(time_ns) for time_ns in self._looks]
        span = self._span(Offset(bare, before, h, now_ns))
        if span is not None:
            left = 0.0 if old is None else (old.end_ns - now_ns) * 1e-9
            self._offset = Offset(bare, _past(state, h), h, now_ns)
            self._offset.last(max(span, left))
        else:
            self._knots, self._piece = given, None
            self._state = self._motion_at(now_ns)

    def _is_within(self, piece: Piece) -> bool:
        """Return whether a piece keeps the limits."""
        pairs = (self._turning, piece.turn), (self._moving, piece.way)
        return all(
            law.share(kind, rate) <= piece.span ** (kind + 1)
            for law, way in pairs[: 1 + self.has_positions]
            for u in _LOOKS
            for kind, rate in enumerate(way.derivatives(u))
        )

    def _span(self, offset: Offset) -> float | None:
        """Return the time in which an offset can fade softly, s.

        If the poses end before, it is the time until then.  ``None`` if the limits forbid that.
        """
        span, most = FADING, (self._knots[-1].time_ns - offset.begin_ns) * 1e-9
        while most > 0.0:
            offset.last(min(span, most))
            excess = self._excess(offset)
            if excess <= CALM or (span >= most and excess <= 1.0):
                return min(span, most)
            if span >= most:
                break
            span *= LONGER
        return None

    def _excess(self, offset: Offset) -> float:
        """Return how much an offset needs of the free part of a limit, at most."""
        laws = (self._turning, self._moving)[: 1 + self.has_positions]
        own, both = [0.0] * (3 * len(laws)), [0.0] * (3 * len(laws))
        for look in _LOOKS:
            time_ns = offset.begin_ns + round(look * (offset.end_ns - offset.begin_ns))
            rates, others = _rates_on(self._knots, time_ns), offset.rates(look)
            for place in range(len(own)):
                law, kind = laws[place // 3], place % 3
                here = rates[place]
                own[place] = max(own[place], law.share(kind, here))
                both[place] = max(both[place], law.share(kind, plus(here, others[place], 1.0)))
        return max((b - a) / max(1.0 - a, LEAST) for a, b in zip(own, both, strict=True))

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
        """Note by how much a chunk contradicts the one before."""
        if not self._knots:
            return
        q, position = sent.q, sent.position
        if self.end.time_ns > sent_ns:
            q, position = _pose_on(self._newest, knot.time_ns)
        apart = norm(plus(knot.position, position, -1.0)) if self.has_positions else 0.0
        self._statistics.note_seam(norm(difference(q, knot.q)), apart)

    def _bare_at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return orientation and position of the curve at an instant, without the offset."""
        knots, piece = self._knots, self._piece
        if piece is not None and piece.here.time_ns <= time_ns < piece.there.time_ns:
            return piece.at(time_ns)
        if knots[0].time_ns <= time_ns < knots[-1].time_ns:
            self._piece = piece = _piece_on(knots, time_ns)
            return piece.at(time_ns)
        return _pose_on(knots, time_ns)

    def _pose_at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return orientation and position of the reference at an instant."""
        q, position = self._bare_at(time_ns)
        offset = self._offset
        if offset is None or time_ns >= offset.end_ns:
            return q, position
        turn, way = offset.at(time_ns)
        return multiply(q, exp(turn)), plus(position, way, 1.0)

    def at(self, now_ns: int) -> tuple[PreviewState, Place | None]:
        """Return the reference at the setpoint before *now_ns*, and how it continues to there.

        To be asked once for every setpoint, in order.
        """
        self._take_over_if_due()
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
        turning = PreviewState(before.q, before.omega, before.alpha, alpha)
        if not self.has_positions:
            return turning, None
        moving = before.position, before.velocity, before.acceleration
        return turning, Place(*moving, acceleration)

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
    """The rest of the motion before a curve, relative to that curve; it fades.

    Attributes:
        begin_ns: when it begins.
        end_ns: time from which it is nothing.
    """

    def __init__(
        self,
        curve: Sequence[tuple[Quaternion, Vector3]],
        motion: Sequence[tuple[Quaternion, Vector3]],
        h: float,
        begin_ns: int,
    ) -> None:
        """Begin at *begin_ns* with the way from a curve to a motion.

        Both are given by their poses at the last three setpoints, *h* s apart, the oldest first.
        """
        pairs = list(zip(curve, motion, strict=True))
        turns = [difference(here[0], there[0]) for here, there in pairs]
        ways = [plus(there[1], here[1], -1.0) for here, there in pairs]
        self._begin = _derivatives(turns, h), _derivatives(ways, h)
        self.begin_ns = begin_ns
        self.last(FADING)

    def last(self, span: float) -> None:
        """Fade within a time, s."""
        self.end_ns, self._span = self.begin_ns + round(1e9 * span), span
        self._fading = [
            quintic(
                plus(ZERO, gap, -1.0),
                plus(ZERO, rate, span),
                plus(ZERO, change, span * span),
                ZERO,
                ZERO,
            )
            for gap, rate, change in self._begin
        ]

    def rates(self, u: float) -> list[Vector3]:
        """Return the first three derivatives of the turn, and then those of the displacement.

        *u* is the part of its time that has passed.
        """
        return [
            plus(ZERO, rate, self._span ** -(kind + 1))
            for fading in self._fading
            for kind, rate in enumerate(fading.derivatives(u))
        ]

    def at(self, time_ns: int) -> tuple[Vector3, Vector3]:
        """Return turn and displacement at an instant before its end."""
        u = (time_ns - self.begin_ns) * 1e-9 / self._span
        turn, way = (
            plus(begin[0], fading.value(u), 1.0)
            for begin, fading in zip(self._begin, self._fading, strict=True)
        )
        return turn, way


def _derivatives(values: Sequence[Vector3], h: float) -> tuple[Vector3, Vector3, Vector3]:
    """Return the last of three values *h* s apart, and its first two derivatives."""
    a, b, c = values
    rate = plus(combine(c, 1.5 / h, b, -2.0 / h), a, 0.5 / h)
    return c, rate, plus(combine(c, 1.0 / h / h, b, -2.0 / h / h), a, 1.0 / h / h)


def _rates_on(knots: Sequence[Knot], time_ns: int) -> tuple[Vector3, ...]:
    """Return velocity, acceleration and jerk of the turn of a curve, and then of its position.

    Between two poses the first two are interpolated linearly.
    """
    place = min(max(bisect_right(knots, time_ns, key=time_of), 1), len(knots) - 1)
    here, there = knots[place - 1], knots[place]
    span = (there.time_ns - here.time_ns) * 1e-9
    share = min(max((time_ns - here.time_ns) * 1e-9 / span, 0.0), 1.0) if span > 0.0 else 0.0
    per = 1.0 / span if span > 0.0 else 0.0
    return (
        combine(here.omega, 1.0 - share, there.omega, share),
        combine(here.alpha, 1.0 - share, there.alpha, share),
        combine(there.alpha, per, here.alpha, -per),
        combine(here.velocity, 1.0 - share, there.velocity, share),
        combine(here.acceleration, 1.0 - share, there.acceleration, share),
        combine(there.acceleration, per, here.acceleration, -per),
    )


def _piece_on(knots: Sequence[Knot], time_ns: int) -> Piece:
    """Return the piece of a curve at an instant between its ends."""
    place = bisect_right(knots, time_ns, key=time_of)
    return Piece(knots[place - 1], knots[place])


def _pose_on(knots: Sequence[Knot], time_ns: int) -> tuple[Quaternion, Vector3]:
    """Return orientation and position of a curve at an instant.

    After its last pose it rests.  Before its first one its velocity and acceleration continue: a
    piece that is read beyond its ends would multiply its rounding.
    """
    first, last = knots[0], knots[-1]
    if time_ns >= last.time_ns:
        return last.q, last.position
    if time_ns >= first.time_ns:
        return _piece_on(knots, time_ns).at(time_ns)
    t = (time_ns - first.time_ns) * 1e-9
    bent = max(t, -BENT)
    bend = bent * (t - 0.5 * bent)
    q = multiply(first.q, exp(combine(first.omega, t, first.alpha, bend)))
    way = combine(first.velocity, t, first.acceleration, bend)
    return q, plus(first.position, way, 1.0)


def _past(state: Motion, h: float) -> list[tuple[Quaternion, Vector3]]:
    """Return the poses of a state, and of one and two setpoints before it, the oldest first."""
    q, position, omega, velocity = state.q, state.position, state.omega, state.velocity
    poses = [(q, position)]
    for _ in range(2):
        q, position = multiply(q, exp(plus(ZERO, omega, -h))), plus(position, velocity, -h)
        poses.append((q, position))
        omega, velocity = plus(omega, state.alpha, -h), plus(velocity, state.acceleration, -h)
    return poses[::-1]


def _knot_of(state: Motion, time_ns: int, h: float) -> Knot:
    """Return a state as a knot, with the derivatives at its instant."""
    omega = plus(state.omega, state.alpha, 0.5 * h)
    velocity = plus(state.velocity, state.acceleration, 0.5 * h)
    at = state.position, velocity, state.acceleration
    return Knot(time_ns, state.q, omega, state.alpha, *at)
