"""The tracker: one setpoint a cycle, towards the current target."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from orientd.driver import IDENTITY, ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, dot, exp, multiply, norm, normalize, plus
from orientd.mechanism.foresight import AxisStop
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
    saturated,
    softened,
    stop_phases,
    stopping_angle,
    times,
)
from orientd.servo.tracking.detour import Detour
from orientd.servo.tracking.preview import Motion, Preview, PreviewState
from orientd.servo.tracking.quintic import Knot
from orientd.servo.tracking.reference import Reference
from orientd.servo.tracking.steering import AccelerationCap, position_command
from orientd.servo.tracking.stop_filter import StopFilter
from orientd.servo.tracking.targets import JUMP, FilteredTarget, ReferenceState, Target
from orientd.stream.records import ServoLimits

_MET = 0.02
"""Largest distance from its target at which the device has met it, rad."""

_ASTRAY = 1e-3
"""Angle to the poses beyond which the device is not on their curve, rad."""

_ARRIVED = 1e-8
"""Angle, rad, and velocity, rad/s, within which the device is at its end."""

_DELAY_STEP = 1e-3
"""Change of the delay that updates the gains, s."""


class TrackPoint(NamedTuple):
    """Setpoint of one cycle: orientation, angular velocity (rad/s) and acceleration (rad/s^2)."""

    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3


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


class Tracker:
    """Follow targets or chunks with bounded angular velocity, acceleration and jerk.

    The bounds are those of the guard: norms of backward differences.  A target with steady motion
    is followed without lag.  When targets end, the motion comes to rest at the last one.  It does
    not pass that target if it is known beforehand to be the last.  Without a live target the motion
    comes to rest as soon as it can, or at the last target if it has met that and that had no
    velocity.

    A target inside a keep-out cone is held at the edge (:class:`.Detour`), and a stop always ends
    outside (:class:`.StopFilter`).

    Attributes:
        is_at_rest: whether nothing turns, no target lives and none waits for its time.
        place: where the position should be, if the target says so.
        end: the target that is known to be the last, and the time until then, s.
        preview: the chunks.
        behind: angle from the last setpoint to the poses of the chunks, rad; zero at their end.
    """

    def __init__(self, period: float, cones: KeepOutCones | None = None) -> None:
        """Create it for one step per *period* seconds; *cones* are those of the device."""
        self._period = period
        self._detour = None if cones is None else Detour(cones, period)
        self._filter = None if cones is None else StopFilter(cones, period)
        self._period_ns = round(period * 1e9)
        self._reference = Reference(period)
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
        self._reference.clear()
        linear = linear_limits_of(servo_limits, self._period)
        self.preview = Preview(self._period, self._limits, self._units, linear)
        self._cap.release()
        self._before, self._wish = (self._q, self._omega, self._alpha), self._alpha
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

    def take(self, target: Target, now_ns: int) -> str:
        """Accept a target; return an empty string, or why it was refused."""
        problem = self._reference.take(target, now_ns)
        if not problem and self.preview.is_on:
            self.preview.clear()
        return problem

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
        is_fresh = self._is_concluded or self.behind > _ASTRAY
        problem = self.preview.take(
            knots, sent, sent_ns, has_positions=has_positions, is_fresh=is_fresh
        )
        if not problem:
            self._reference.clear()
            self._forget()
        return problem

    def cease(self) -> None:
        """Forget every target, and come to rest."""
        self._reference.clear()
        self.preview.clear()
        self._forget()

    def _forget(self) -> None:
        self.place: Place | None = None
        self.end: tuple[Target, float] | None = None
        self._last: FilteredTarget | None = None
        self._home: Target | None = None
        self._has_met = self._is_concluded = False
        self.behind = 0.0
        if self._detour is not None:
            self._detour.forget()

    def step(self, now_ns: int) -> TrackPoint:
        """Return the setpoint of the cycle with deadline *now_ns*."""
        if self._loose is not self._limits:
            self._loose = loosened(self._limits, self._omega, self._alpha)
        # State and target at the same time, that of the last setpoint.
        found: ReferenceState | PreviewState | None
        if self.preview.is_on:
            found = self._previewed(now_ns)
        else:
            found = self._found(now_ns - self._period_ns)
        if found is None:
            if self._omega == ZERO == self._alpha:
                self.is_at_rest = not self._reference.awaits
                self._before, self._wish = (self._q, ZERO, ZERO), ZERO
                return TrackPoint(self._q, ZERO, ZERO)
            omega, alpha = self._stopped()
            wish = self._filtered(alpha)
            self._wish = wish
            return self._move(
                omega if wish is alpha else plus(self._omega, wish, self._period), wish
            )
        self.is_at_rest = False
        if isinstance(found, PreviewState):
            wanted = self._wanted_ahead(found)
        else:
            wanted = self._wanted(found)
        alpha = self._filtered(advance(self._omega, self._alpha, wanted, self._loose))
        self._wish = alpha
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

    def stops_outside(self) -> bool:
        """Return whether a stop from the last step ends outside of the cones."""
        if self._filter is None:
            return True
        q, omega, _ = self._before
        return self._filter.is_safe(q, omega, self._alpha, self._loose)

    def _stopped(self) -> tuple[Vector3, Vector3]:
        """Return velocity and acceleration after one more cycle towards rest."""
        if not self._servo_limits.has_axes:
            return halt(self._omega, self._alpha, self._loose)
        units = self._units
        omega, alpha = times(self._omega, units), times(self._alpha, units)
        omega, alpha = halt_inside(omega, alpha, self._servo_limits, self._period)
        return divided(omega, units), divided(alpha, units)

    def ease(self, share: float | None) -> TrackPoint:
        """Undo the last step; take a *share* of its change of velocity instead, or brake."""
        self._q, self._omega, self._alpha = self._before
        if share is None:
            return self._move(*halt(self._omega, self._alpha, self._loose))
        even = saturated(self._alpha, ZERO, self._loose)
        alpha = combine(even, 1.0 - share, self._wish, share)
        return self._move(plus(self._omega, alpha, self._period), alpha)

    def stop_ahead(self) -> tuple[Quaternion, AxisStop | None]:
        """Return the first cycle of a stop, and the rest of the stop from there, if any."""
        limits, h = self._limits, self._period
        omega, alpha = halt(self._omega, self._alpha, self._loose)
        q = multiply(self._q, exp(plus(ZERO, times(omega, self._units), h)))
        # The approximate axis of the turn after the acceleration has run out.
        ahead = plus(omega, alpha, 0.5 * (norm(alpha) / limits.jerk + h))
        size = norm(ahead)
        if size < _ARRIVED:
            return q, None
        axis = plus(ZERO, ahead, 1.0 / size)
        speed, rate = dot(omega, axis), dot(alpha, axis)
        speed += 0.5 * h * rate
        phases = stop_phases(speed, rate, limits.acceleration, limits.jerk)
        return q, AxisStop(times(axis, self._units), speed, rate, phases, limits.jerk)

    def _move(self, omega: Vector3, alpha: Vector3) -> TrackPoint:
        """Turn for a period; all in the law's units."""
        self._before = self._q, self._omega, self._alpha
        self._omega, self._alpha = omega, alpha
        if self._filter is not None:
            # In its own units the law never turns by less than in radians.
            self._filter.room.shrink(norm(omega) * self._period)
        omega = times(omega, self._units)
        self._q = normalize(multiply(self._q, exp(plus(ZERO, omega, self._period))))
        return TrackPoint(self._q, omega, times(alpha, self._units))

    def _found(self, now_ns: int) -> ReferenceState | None:
        """Return the reference at *now_ns*; ``None`` to come to rest anywhere."""
        reference = self._reference
        found = reference.at(now_ns)
        self.end = reference.end(now_ns)
        if found is None:
            return self._expired()
        if self.end is not None and self._must_brake(self.end[0].q, self.end[1]):
            reference.conclude()
            found = reference.at(now_ns) or found
        where = reference.position_at(now_ns)
        self.place = None if where is None else Place(*where)
        last = reference.last
        if last is not None:
            self._note(last, found)
        return found

    def _note(self, last: FilteredTarget, found: ReferenceState) -> None:
        """Record whether the device has met its target, and where it must end."""
        if last is not self._last:
            self._last = last
            if last.begins and norm(difference(self._q, last.target.q)) > JUMP:
                self._has_met = False
        if not self._has_met:
            self._has_met = norm(difference(self._q, found.q)) < _MET
        is_order = last.turning is not None or last.omega == ZERO
        self._home = last.target if self._has_met and is_order else None

    def _expired(self) -> ReferenceState | None:
        """Return the expired target while the device has not reached it."""
        home = self._home
        self.place = None
        if home is None:
            return None
        if home.position is not None:
            self.place = Place(home.position, ZERO)
        if norm(self._omega) < _ARRIVED and norm(difference(self._q, home.q)) < _ARRIVED:
            return None
        return ReferenceState(home.q, ZERO, ZERO)

    def _previewed(self, now_ns: int) -> ReferenceState | PreviewState:
        """Return what to follow of the chunks, on the way to the setpoint due at *now_ns*."""
        preview = self.preview
        found, end = preview.at(now_ns), preview.end
        left_ns = end.time_ns - now_ns + self._period_ns
        position = end.position if preview.has_positions else None
        last = Target(end.q, None, end.time_ns, end.time_ns, position)
        self.end = (last, left_ns * 1e-9) if left_ns > 0 else None
        if position is None:
            self.place = None
        else:
            moving = found.position, found.velocity, found.acceleration, found.next_acceleration
            self.place = Place(*moving)
        if not self._is_concluded:
            self._is_concluded = left_ns <= 0 or (
                not preview.is_continued(now_ns) and self._must_brake(end.q, left_ns * 1e-9)
            )
        if self._is_concluded:
            self.behind = 0.0
            return ReferenceState(end.q, ZERO, ZERO)
        gap = difference(self._q, found.q)
        self.behind = norm(gap)
        preview.lag.note(gap, found.omega)
        return found

    def _must_brake(self, q: Quaternion, left: float) -> bool:
        """Whether a stop that begins later would pass the end *q*, *left* s before its time."""
        speed = norm(self._omega)
        if speed < _ARRIVED:
            return False
        way = divided(difference(self._q, q), self._units)
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
        if self._reference.is_disturbed:
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
        delay = self._reference.delay
        if abs(delay - self._soft_for) > _DELAY_STEP:
            self._soften(delay)
        return self._soft

    def _soften(self, delay: float) -> None:
        self._soft, self._soft_for = softened(self._limits, delay), delay
