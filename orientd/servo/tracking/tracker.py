"""The tracker: one setpoint a cycle, towards the current target."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from orientd.driver import IDENTITY, ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, dot, exp, multiply, norm, normalize, plus
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.tracking.chunks import Chunk
from orientd.servo.tracking.detour import Detour
from orientd.servo.tracking.guidance import Guidance
from orientd.servo.tracking.law import NO_LIMITS, SLACK, Calm, Course, Gains, Law
from orientd.servo.tracking.preview import Motion, PreviewState
from orientd.servo.tracking.reference import ReferenceState, Target
from orientd.servo.tracking.stop_filter import RESERVE, StopFilter
from orientd.stream.records import ServoLimits

_ARRIVED = 1e-8
"""Angular velocity below which the device stands, rad/s."""

_STILL = 1e-12
"""Angular velocity that counts as zero, rad/s: a thousandth of the guard's rounding."""

_TWIST = 0.03
"""Time over which the jerk of the targets is averaged, s."""

_REST = Course(ZERO, ZERO, ZERO)


class TrackPoint(NamedTuple):
    """Setpoint of one cycle: orientation, angular velocity (rad/s) and acceleration (rad/s^2)."""

    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3


class Tracker:
    """Follow targets or chunks with bounded angular velocity, acceleration and jerk.

    The bounds are those of the guard: norms of backward differences.  A target with steady motion
    is followed without lag.  The :class:`.Guidance` decides what is
    followed, and where it ends.

    A target inside a keep-out cone is held at the edge (:class:`.Detour`), and a stop always ends
    outside (:class:`.StopFilter`).

    Attributes:
        is_at_rest: whether nothing turns, no target lives and none waits for its time.
        guidance: what to follow.
    """

    def __init__(self, period: float, cones: KeepOutCones | None = None) -> None:
        """Create it for one step per *period* seconds; *cones* are those of the device."""
        self._period = period
        self._detour = None if cones is None else Detour(cones, period)
        self._filter = None if cones is None else StopFilter(cones, period)
        self._period_ns = round(period * 1e9)
        self.guidance = Guidance(period)
        self._law = Law(period)
        self._calm = Calm(period)
        self.begin(IDENTITY, ZERO, ZERO, NO_LIMITS)

    def begin(
        self,
        q: Quaternion,
        omega_body: Vector3,
        alpha_body: Vector3,
        servo_limits: ServoLimits,
    ) -> None:
        """Begin from the last command, moving or at rest, without any target.

        The rates are backward differences.  A motion beyond the limits is slowed down first.
        """
        self._law.limit_turn(servo_limits)
        self._q, self._omega, self._alpha = q, omega_body, alpha_body
        self.guidance.begin(servo_limits)
        self._calm.release()
        self._forget()
        self.is_at_rest = omega_body == ZERO == alpha_body
        if self._filter is not None:
            self._filter.room.forget()

    def rest(self, q: Quaternion) -> None:
        """Continue from rest at *q*, with the previous target."""
        self._q, self._omega, self._alpha = q, ZERO, ZERO
        if self._filter is not None:
            self._filter.room.forget()

    @property
    def held(self) -> int:
        """Place of the keep-out cone that holds the target at its edge; -1 for none."""
        return -1 if self._detour is None else self._detour.held

    def take(self, target: Target, now_ns: int) -> str:
        """Accept a target; return an empty string, or why it was refused."""
        return self.guidance.take(target, now_ns)

    def take_chunk(self, chunk: Chunk, sent: Motion, sent_ns: int) -> str:
        """Take a chunk; return an empty string, or why it was refused.

        Args:
            chunk: its times ascend.
            sent: the last setpoint.
            sent_ns: the time of that.
        """
        problem = self.guidance.take_chunk(chunk, sent, sent_ns)
        if not problem:
            self._forget_need()
        return problem

    def cease(self) -> None:
        """Forget every target, and come to rest."""
        self.guidance.cease()
        self._forget()

    def _forget_need(self) -> None:
        self._twist = self._last_alpha = ZERO
        self._law.need.forget()

    def _forget(self) -> None:
        self._forget_need()
        if self._detour is not None:
            self._detour.forget()

    def step(self, now_ns: int) -> TrackPoint:
        """Return the setpoint of the cycle with deadline *now_ns*."""
        found = self.guidance.look(now_ns, self)
        if found is None:
            if self._omega == ZERO == self._alpha:
                self.is_at_rest = not self.guidance.awaits
                return TrackPoint(self._q, ZERO, ZERO)
            if norm(self._omega) < _STILL and norm(self._alpha) * self._period < _STILL:
                return self._move(ZERO, ZERO)
            alpha = self._law.halt(self._omega, self._alpha)
        else:
            self.is_at_rest = False
            alpha = self._ahead(found) if isinstance(found, PreviewState) else self._towards(found)
        if self._filter is not None:
            alpha = self._filter.filtered(self._q, self._omega, self._alpha, alpha, self._law)
        return self._move(plus(self._omega, alpha, self._period), alpha)

    @property
    def is_clear(self) -> bool:
        """Whether no stop from the last setpoint reaches a keep-out cone."""
        return self._filter is None or self._filter.is_clear(self._q, self._omega, self._law)

    def _move(self, omega: Vector3, alpha: Vector3) -> TrackPoint:
        """Turn for a period."""
        self._omega, self._alpha = omega, alpha
        if self._filter is not None:
            self._filter.room.shrink(norm(omega) * self._period)
        self._q = normalize(multiply(self._q, exp(plus(ZERO, omega, self._period))))
        return TrackPoint(self._q, omega, alpha)

    def moving(self) -> tuple[Quaternion, float]:
        """Return the orientation of the last setpoint, and its angular speed, rad/s."""
        return self._q, norm(self._omega)

    def must_brake(self, target: Target, left: float) -> bool:
        """Return whether a stop that begins later would pass the end *target*, *left* s before."""
        speed = norm(self._omega)
        if speed < _ARRIVED:
            return False
        along = dot(difference(self._q, target.q), self._omega) / speed
        # The next setpoint continues to turn for two cycles.
        stop = self._law.stopping_way(self._omega, self._alpha) + 2.0 * self._period * speed
        return speed * left <= 2.0 * stop and along <= stop

    def _towards(self, found: ReferenceState) -> Vector3:
        """Return the acceleration of the next step towards a target."""
        law, calm = self._law, self._calm
        around = self._around(found.q, found.omega)
        if around is not None:
            return around
        turn = difference(self._q, found.q)
        if found.omega == ZERO:
            return self._closing_in(turn, law.rest)
        # The velocity of a step is that of its middle.
        middle = plus(found.omega, found.alpha, -0.5 * self._period)
        gains, needed = self._soft, inf
        if self.guidance.reference.is_disturbed:
            relative = norm(plus(self._omega, middle, -1.0))
            needed = gains.settle * max(gains.approach * norm(turn), relative)
        calm.note(found.alpha, needed, law.acceleration)
        change = plus(found.alpha, found.lead, 1.0)
        course = Course(middle, change, change)
        state = turn, self._omega, self._alpha
        alpha = law.pursue(state, course, gains, calm=calm, slack=SLACK)
        self._note_twist(found.alpha)
        law.need.note(law.taken)
        return alpha

    def _note_twist(self, alpha: Vector3) -> None:
        """Note the acceleration of the target, for the share of the jerk that it takes."""
        law, h = self._law, self._period
        share = h / _TWIST
        jerk = combine(alpha, 1.0 / h, self._last_alpha, -1.0 / h)
        self._twist = combine(self._twist, 1.0 - share, jerk, share)
        self._last_alpha = alpha
        law.taken[2] = law.share(2, self._twist)

    def _ahead(self, found: PreviewState) -> Vector3:
        """Return the acceleration of the next step along what is known ahead."""
        law = self._law
        around = self._around(found.q, found.omega)
        if around is not None:
            return around
        turn = difference(self._q, found.q)
        if found.omega == ZERO == found.next_alpha:
            return self._closing_in(turn, law.rest)
        course = Course(found.omega, found.alpha, found.next_alpha)
        alpha = law.pursue((turn, self._omega, self._alpha), course, self._soft)
        law.need.note(law.taken)
        return alpha

    def _closing_in(self, turn: Vector3, gains: Gains) -> Vector3:
        """Return the acceleration of the next step along a turn that ends at rest."""
        self._calm.release()
        self._forget_need()
        return self._law.pursue((turn, self._omega, self._alpha), _REST, gains)

    def _around(self, target: Quaternion, omega: Vector3) -> Vector3 | None:
        """Return the acceleration of the next step around keep-out cones.

        ``None`` for the direct path.  *omega* is the target's angular velocity.
        """
        if self._detour is None or self._filter is None:
            return None
        away = norm(difference(self._q, target))
        # Targets keep farther away than stops, which then leave the law alone.
        reserve = 2.0 * RESERVE
        if not self._filter.room.is_within(self._q, away + reserve):
            self._detour.forget()
            return None
        turn = self._detour.turn(self._q, target, reserve)
        if turn is None:
            return None
        return self._closing_in(turn, self._law.rest if omega == ZERO else self._soft)

    @property
    def _soft(self) -> Gains:
        """The gains for a moving target."""
        return self._law.rest.softened(self._period)
