r"""The setpoint of a MAVLink gimbal: frames, unset values and rates.

MAVLink's earth frame has x north, y east and z down, and its gimbal frame has x forward, y right
and z down.  orientd's world is the base of the gimbal.  World and tool have x forward, y left and
z up.  Only :func:`mirrored` and :func:`mirrored_turn` convert, in both directions.

An attitude is three angles (roll, pitch, yaw) of :math:`R_z(yaw) R_y(pitch) R_x(roll)` relative to
a frame that the flags of a message choose for each axis: the earth, or the vehicle.  Rates are
those of the three angles, as PX4 and ArduPilot take them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from orientd.driver import Quaternion, Vector3
from orientd.floats import conjugate, multiply

RETRACT, NEUTRAL, ROLL_LOCK, PITCH_LOCK, YAW_LOCK = 1, 2, 4, 8, 16
YAW_IN_VEHICLE_FRAME, YAW_IN_EARTH_FRAME, ACCEPTS_YAW_IN_EARTH_FRAME = 32, 64, 128
"""Flags of a gimbal device; those of a gimbal manager have the same values."""

UNSET = (math.nan, math.nan, math.nan)

_POLE = 1e-4
"""Cosine of the pitch below which the roll counts as zero, since the yaw then includes it."""


def mirrored(v: Vector3) -> Vector3:
    """Return a vector with right and left, and up and down, exchanged."""
    return (v[0], -v[1], -v[2])


def mirrored_turn(q: Quaternion) -> Quaternion:
    """Return an orientation in forward, right, down for one in forward, left, up, and back."""
    return (q[0], q[1], -q[2], -q[3])


def of_angles(angles: Vector3) -> Quaternion:
    """Return the quaternion of roll, pitch and yaw, rad."""
    (a, x), (b, y), (c, z) = ((math.cos(0.5 * one), math.sin(0.5 * one)) for one in angles)
    return (
        a * b * c + x * y * z,
        x * b * c - a * y * z,
        a * y * c + x * b * z,
        a * b * z - x * y * c,
    )


def angles_of(q: Quaternion) -> Vector3:
    """Return roll, pitch and yaw of a unit quaternion, rad; straight up and down too.

    >>> [round(math.degrees(one), 3) for one in angles_of(of_angles((0.0, -math.pi / 2, 1.0)))]
    [0.0, -90.0, 57.296]
    """
    w, x, y, z = q
    level = math.hypot(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
    pitch = math.atan2(2.0 * (w * y - x * z), level)
    if level < _POLE:
        return (0.0, pitch, math.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z)))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return (roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


@dataclass(frozen=True, slots=True)
class Base:
    """The attitude of the gimbal's base, or of the vehicle that carries it, in the earth frame.

    Attributes:
        roll: rad.
        pitch: rad.
        heading: yaw from north, rad; ``None`` if it is unknown.
    """

    roll: float = 0.0
    pitch: float = 0.0
    heading: float | None = None

    @property
    def q(self) -> Quaternion:
        """Orientation in the earth frame, with a heading of 0 if it is unknown."""
        return of_angles((self.roll, self.pitch, self.heading or 0.0))

    def frame(self, flags: int, *, from_north: bool) -> Quaternion:
        """Return the frame of three angles, relative to the earth.

        Args:
            flags: roll and pitch are relative to the horizon if locked, else to the vehicle.
            from_north: whether the yaw is relative to north, else to the heading.
        """
        roll = 0.0 if flags & ROLL_LOCK else self.roll
        pitch = 0.0 if flags & PITCH_LOCK else self.pitch
        return of_angles((roll, pitch, 0.0 if from_north else self.heading or 0.0))


@dataclass(frozen=True, slots=True)
class Wish:
    """A request to the gimbal; NaN leaves a value as it is.

    Attributes:
        flags: of the message.
        angles: roll, pitch and yaw, rad.
        rates: of these angles, rad/s.  With its angle, a rate is the speed at which to reach it.
    """

    flags: int
    angles: Vector3 = UNSET
    rates: Vector3 = UNSET

    @property
    def is_from_north(self) -> bool:
        """Whether the yaw is relative to north; without a flag of a frame, the lock decides."""
        frames = self.flags & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME)
        return bool(self.flags & (YAW_IN_EARTH_FRAME if frames else YAW_LOCK))

    @property
    def needs_heading(self) -> bool:
        """Whether only a gimbal that knows where north is can do it."""
        return self.is_from_north or bool(self.flags & YAW_LOCK)

    @property
    def is_still(self) -> bool:
        """Whether it asks for angles, and for no rate."""
        is_unset = all(map(math.isnan, self.angles))
        return not is_unset and not any(rate for rate in self.rates if not math.isnan(rate))

    @property
    def is_valid(self) -> bool:
        """Whether every number is finite or unset, and the yaw has one frame."""
        both = YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME
        is_finite = not any(map(math.isinf, (*self.angles, *self.rates)))
        return is_finite and self.flags & both != both


@dataclass(slots=True)
class Setpoint:
    """The commanded attitude, and how it moves.

    Attributes:
        acceleration: of the angles while they move at a rate, rad/s^2.
        flags: those that apply.
        angles: roll, pitch and yaw now, rad, in the frame of the flags.
        rates: of the angles now, rad/s.
        goals: angles to reach, rad; of an angle that turns at a rate, where it is now.
        speeds: largest speeds on the way to the goals, rad/s; infinite for at once.
        turns: wanted rates, rad/s; NaN of an angle with a goal.
    """

    acceleration: float
    flags: int = ROLL_LOCK | PITCH_LOCK
    angles: list[float] = field(default_factory=lambda: [0.0] * 3)
    rates: list[float] = field(default_factory=lambda: [0.0] * 3)
    goals: list[float] = field(default_factory=lambda: [0.0] * 3)
    speeds: list[float] = field(default_factory=lambda: [math.inf] * 3)
    turns: list[float] = field(default_factory=lambda: [math.nan] * 3)

    @property
    def is_moving(self) -> bool:
        """Whether the angles change at a rate, now or with the next :meth:`advance`."""
        return any(
            rate != 0.0 or (speed < math.inf if math.isnan(turn) else turn != 0.0)
            for rate, speed, turn in zip(self.rates, self.speeds, self.turns, strict=True)
        )

    def begin(self, q: Quaternion, base: Base) -> None:
        """Stand still at an orientation of the tool in the device's world."""
        frame = base.frame(self.flags, from_north=bool(self.flags & YAW_LOCK))
        turn = multiply(conjugate(frame), multiply(base.q, mirrored_turn(q)))
        self.angles, self.goals = list(angles_of(turn)), list(angles_of(turn))
        self.rates, self.speeds, self.turns = [0.0] * 3, [math.inf] * 3, [math.nan] * 3

    def take(self, wish: Wish, base: Base) -> None:
        """Take over the request of a message; an unset angle keeps its last setpoint."""
        if wish.flags & NEUTRAL:
            wish = Wish(NEUTRAL | ROLL_LOCK | PITCH_LOCK, (0.0, 0.0, 0.0))
        before = base.frame(self.flags, from_north=bool(self.flags & YAW_LOCK))
        asked = base.frame(wish.flags, from_north=wish.is_from_north)
        after = base.frame(wish.flags, from_north=bool(wish.flags & YAW_LOCK))
        now, goals = _seen(before, self.angles, asked), _seen(before, self.goals, asked)
        for k, (angle, rate) in enumerate(zip(wish.angles, wish.rates, strict=True)):
            if not math.isnan(angle):
                is_slow = not math.isnan(rate) and rate != 0.0
                goals[k], self.speeds[k] = angle, abs(rate) if is_slow else math.inf
                self.turns[k] = math.nan
            elif not math.isnan(rate):
                goals[k], self.turns[k] = now[k], rate
            elif not math.isnan(self.turns[k]):
                self.turns[k] = 0.0
        self.angles, self.goals = _seen(asked, now, after), _seen(asked, goals, after)
        self.flags = wish.flags

    def rest(self) -> None:
        """Let every angle that turns at a rate come to rest."""
        self.turns = [one if math.isnan(one) else 0.0 for one in self.turns]

    def advance(self, seconds: float, *, is_behind: bool = False) -> None:
        """Move the angles.

        Args:
            seconds: since the last call.
            is_behind: whether the device cannot follow; then no angle turns on without a goal.
        """
        change = self.acceleration * seconds
        for k, (turn, speed) in enumerate(zip(self.turns, self.speeds, strict=True)):
            has_goal = math.isnan(turn)
            if has_goal and speed == math.inf:
                self.angles[k], self.rates[k] = self.goals[k], 0.0
                continue
            left = math.remainder(self.goals[k] - self.angles[k], math.tau)
            if has_goal:
                # It brakes with half of the acceleration, so that the device need not overshoot.
                wanted = math.copysign(min(speed, math.sqrt(self.acceleration * abs(left))), left)
            else:
                wanted = 0.0 if is_behind else turn
            rate = self.rates[k] + max(-change, min(change, wanted - self.rates[k]))
            if has_goal and abs(left) <= abs(rate) * seconds:
                self.angles[k], self.rates[k], self.speeds[k] = self.goals[k], 0.0, math.inf
                continue
            self.angles[k] += rate * seconds
            self.rates[k] = rate
            if not has_goal:
                self.goals[k] = self.angles[k]

    def orientation(self, base: Base) -> Quaternion:
        """Return the orientation of the tool in the device's world."""
        roll, pitch, yaw = self.angles
        frame = base.frame(self.flags, from_north=bool(self.flags & YAW_LOCK))
        turn = multiply(frame, of_angles((roll, pitch, yaw)))
        return mirrored_turn(multiply(conjugate(base.q), turn))

    def omega_body(self) -> Vector3:
        """Return the angular velocity of the tool in its own axes, rad/s, of a base at rest."""
        (roll, pitch, _), (dr, dp, dy) = self.angles, self.rates
        s, c, level = math.sin(roll), math.cos(roll), dy * math.cos(pitch)
        return mirrored((dr - dy * math.sin(pitch), dp * c + level * s, level * c - dp * s))


def _seen(frame: Quaternion, angles: Sequence[float], other: Quaternion) -> list[float]:
    """Return the angles relative to *other* of an attitude relative to *frame*."""
    roll, pitch, yaw = angles
    return list(
        angles_of(multiply(conjugate(other), multiply(frame, of_angles((roll, pitch, yaw)))))
    )
