"""The tracker: one setpoint a cycle, towards the current target."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from orientd.driver import IDENTITY, ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, dot, exp, multiply, norm, normalize, plus
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.motion_law import (
    NO_LIMITS,
    TrackingLimits,
    advance,
    divided,
    halt,
    halt_inside,
    limits_of,
    linear_limits_of,
    loosened,
    softened,
    stopping_angle,
    times,
)
from orientd.servo.tracking.detour import Detour
from orientd.servo.tracking.guidance import Guidance
from orientd.servo.tracking.preview import Motion, Preview, PreviewState
from orientd.servo.tracking.quintic import Knot
from orientd.servo.tracking.steering import AccelerationCap, position_command
from orientd.servo.tracking.stop_filter import StopFilter
from orientd.servo.tracking.targets import ReferenceState, Target
from orientd.stream.records import ServoLimits

_ARRIVED = 1e-8
"""Angular velocity below which the device stands, rad/s."""

_DELAY_STEP = 1e-3
"""Change of the delay that updates the gains, s."""


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
        self._cap = AccelerationCap(period)
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
        self._servo_limits = servo_limits
        self._limits, self._units = limits_of(servo_limits, self._period)
        # The law's state is in its own units.
        self._q = q
        self._omega = divided(omega_body, self._units)
        self._alpha = divided(alpha_body, self._units)
        linear = linear_limits_of(servo_limits, self._period)
        self.guidance.begin(self._limits, self._units, linear)
        self._cap.release()
        self._forget()
        self.is_at_rest = omega_body == ZERO == alpha_body
        if self._filter is not None:
            self._filter.begin(self._limits, self._units)
        self._soften(0.0)
        self._loose = loosened(self._limits, self._omega, self._alpha)

    def rest(self, q: Quaternion) -> None:
        """Continue from rest at *q*, with the previous target."""
        self._q, self._omega, self._alpha = q, ZERO, ZERO
        self._loose = self._limits
        if self._filter is not None:
            self._filter.room.forget()

    @property
    def held(self) -> int:
        """Place of the keep-out cone that holds the target at its edge; -1 for none."""
        return -1 if self._detour is None else self._detour.held

    @property
    def preview(self) -> Preview:
        """The chunks."""
        return self.guidance.preview

    def take(self, target: Target, now_ns: int) -> str:
        """Accept a target; return an empty string, or why it was refused."""
        return self.guidance.take(target, now_ns)

    def take_chunk(
        self,
        knots: Sequence[Knot],
        now_ns: int,
        moving: tuple[Vector3, Vector3, Vector3],
        *,
        has_positions: bool,
    ) -> str:
        """Take a chunk that arrived in the cycle that is due at *now_ns*.

        Args:
            knots: its curve, times ascending.
            now_ns: when the next setpoint is due.
            moving: position (m), velocity (m/s) and acceleration (m/s^2) at the last setpoint.
            has_positions: whether the chunk says where to be.

        Returns:
            An empty string, or why it was refused.
        """
        units, sent_ns = self._units, now_ns - self._period_ns
        sent = Motion(self._q, times(self._omega, units), times(self._alpha, units), *moving)
        problem = self.guidance.take_chunk(knots, sent, sent_ns, has_positions=has_positions)
        if not problem:
            self._forget()
        return problem

    def cease(self) -> None:
        """Forget every target, and come to rest."""
        self.guidance.cease()
        self._forget()

    def _forget(self) -> None:
        if self._detour is not None:
            self._detour.forget()

    def step(self, now_ns: int) -> TrackPoint:
        """Return the setpoint of the cycle with deadline *now_ns*."""
        if self._loose is not self._limits:
            self._loose = loosened(self._limits, self._omega, self._alpha)
        found = self.guidance.look(now_ns, self)
        if found is None:
            if self._omega == ZERO == self._alpha:
                self.is_at_rest = not self.guidance.awaits
                return TrackPoint(self._q, ZERO, ZERO)
            omega, alpha = self._stopped()
            wish = self._filtered(alpha)
            return self._move(
                omega if wish is alpha else plus(self._omega, wish, self._period), wish
            )
        self.is_at_rest = False
        if isinstance(found, PreviewState):
            wanted = self._wanted_ahead(found)
        else:
            wanted = self._wanted(found)
        alpha = self._filtered(advance(self._omega, self._alpha, wanted, self._loose))
        return self._move(plus(self._omega, alpha, self._period), alpha)

    def _filtered(self, alpha: Vector3) -> Vector3:
        """Return an acceleration of the next step from which a stop ends outside of the cones."""
        if self._filter is None:
            return alpha
        return self._filter.filtered(self._q, self._omega, self._alpha, alpha, self._loose)

    @property
    def is_clear(self) -> bool:
        """Whether no stop from the last setpoint reaches a keep-out cone."""
        return self._filter is None or self._filter.is_clear(self._q, self._omega, self._loose)

    def _stopped(self) -> tuple[Vector3, Vector3]:
        """Return velocity and acceleration after one more cycle towards rest."""
        if not self._servo_limits.has_axes:
            return halt(self._omega, self._alpha, self._loose)
        units = self._units
        omega, alpha = times(self._omega, units), times(self._alpha, units)
        omega, alpha = halt_inside(omega, alpha, self._servo_limits, self._period)
        return divided(omega, units), divided(alpha, units)

    def _move(self, omega: Vector3, alpha: Vector3) -> TrackPoint:
        """Turn for a period; all in the law's units."""
        self._omega, self._alpha = omega, alpha
        if self._filter is not None:
            # In its own units the law never turns by less than in radians.
            self._filter.room.shrink(norm(omega) * self._period)
        omega = times(omega, self._units)
        self._q = normalize(multiply(self._q, exp(plus(ZERO, omega, self._period))))
        return TrackPoint(self._q, omega, times(alpha, self._units))

    def moving(self) -> tuple[Quaternion, float]:
        """Return the orientation of the last setpoint, and its angular speed, rad/s."""
        return self._q, norm(times(self._omega, self._units))

    def must_brake(self, target: Target, left: float) -> bool:
        """Return whether a stop that begins later would pass the end *target*, *left* s before."""
        speed = norm(self._omega)
        if speed < _ARRIVED:
            return False
        way = divided(difference(self._q, target.q), self._units)
        along, rate = dot(way, self._omega) / speed, dot(self._alpha, self._omega) / speed
        # The next setpoint continues to turn for two cycles.
        stop = stopping_angle(speed, rate, self._limits.acceleration, self._limits.jerk)
        stop += 2.0 * self._period * speed
        return speed * left <= 2.0 * stop and along <= stop

    def _wanted(self, found: ReferenceState) -> Vector3:
        """Return the acceleration to aim at, to follow the target, in the law's units."""
        units, cap = self._units, self._cap
        around = self._around(found.q, found.omega)
        if around is not None:
            cap.release()
            return around
        # The velocity of a step is that of its middle.
        middle = divided(plus(found.omega, found.alpha, -0.5 * self._period), units)
        turn, alpha = divided(difference(self._q, found.q), units), divided(found.alpha, units)
        if found.omega == ZERO:
            cap.release()
            return position_command(turn, self._omega, self._alpha, middle, alpha, self._limits)[0]
        limits, needed = self._softened(), inf
        if self.guidance.reference.is_disturbed:
            relative = norm(plus(self._omega, middle, -1.0))
            needed = limits.settle * max(limits.approach * norm(turn), relative)
        margin = cap.margin(alpha, needed, limits.acceleration)
        alpha = plus(alpha, divided(found.lead, units), 1.0)
        wanted, is_linear = position_command(
            turn, self._omega, self._alpha, middle, alpha, limits, margin
        )
        return cap.capped(wanted, is_linear=is_linear)

    def _wanted_ahead(self, found: PreviewState) -> Vector3:
        """Return the acceleration to aim at, to follow what is known ahead, in the law's units."""
        units = self._units
        around = self._around(found.q, found.omega)
        if around is not None:
            return around
        turn, omega = divided(difference(self._q, found.q), units), divided(found.omega, units)
        alpha, following = divided(found.alpha, units), divided(found.next_alpha, units)
        limits = self._limits if found.omega == ZERO == found.next_alpha else self._softened()
        wanted, is_linear = position_command(turn, self._omega, self._alpha, omega, alpha, limits)
        # Close to the reference the next step is that of the reference.
        return plus(wanted, combine(following, 1.0, alpha, -1.0), 1.0) if is_linear else wanted

    def _around(self, target: Quaternion, omega: Vector3) -> Vector3 | None:
        """Return the acceleration to aim at, around keep-out cones; ``None`` for the direct path.

        *omega* is the target's angular velocity.
        """
        if self._detour is None or self._filter is None:
            return None
        away = norm(difference(self._q, target))
        # Targets keep farther away than stops, which then leave the law alone.
        reserve = 2.0 * self._filter.reserve
        if not self._filter.room.is_within(self._q, away + reserve):
            self._detour.forget()
            return None
        turn = self._detour.turn(self._q, target, reserve)
        if turn is None:
            return None
        limits = self._limits if omega == ZERO else self._softened()
        turn = divided(turn, self._units)
        return position_command(turn, self._omega, self._alpha, ZERO, ZERO, limits)[0]

    def _softened(self) -> TrackingLimits:
        """Return the limits and gains for a moving target, at the present delay."""
        delay = self.guidance.reference.delay
        if abs(delay - self._soft_for) > _DELAY_STEP:
            self._soften(delay)
        return self._soft

    def _soften(self, delay: float) -> None:
        self._soft, self._soft_for = softened(self._limits, delay), delay
