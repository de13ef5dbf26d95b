r"""The setpoint of a MAVLink gimbal: frames, the requests of messages, and the path to their goals.

MAVLink's earth frame has x north, y east and z down, and its gimbal frame has x forward, y right
and z down.  orientd's world is the base of the gimbal.  World and tool have x forward, y left and
z up.  Only :func:`mirrored` converts, in both directions.

An attitude is three angles (roll, pitch, yaw) of :math:`R_z(yaw) R_y(pitch) R_x(roll)` relative to
a frame that the flags of a message choose for each axis: the earth, or the vehicle.  Rates are
those of the three angles, as PX4 and ArduPilot take them.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from orientd.driver import Quaternion
from orientd.floats import conjugate, exp, multiply, normalize
from orientd.tolerances import TYPED_NORM_TOLERANCE

RETRACT, NEUTRAL, ROLL_LOCK, PITCH_LOCK, YAW_LOCK = 1, 2, 4, 8, 16
YAW_IN_VEHICLE_FRAME, YAW_IN_EARTH_FRAME, ACCEPTS_YAW_IN_EARTH_FRAME = 32, 64, 128
"""Flags of a gimbal device; those of a gimbal manager have the same values."""

UNSET = (math.nan, math.nan, math.nan)

STEP = 0.02
"""Time between two poses of the path to the goals, s."""

_BRAKE = 0.8
"""Share of the acceleration with which an angle brakes towards its goal."""

_AHEAD = 1.5
"""Gaps between two messages that an angle takes to its newest goal, so that it does not stop."""

_POLE = 1e-4
"""Cosine of the pitch below which the roll counts as zero, since the yaw then includes it."""


def mirrored(q: Quaternion) -> Quaternion:
    """Return an orientation in (forward, right, down) for one in (forward, left, up), and back."""
    return (q[0], q[1], -q[2], -q[3])


def of_angles(angles: Sequence[float]) -> Quaternion:
    """Return the quaternion of roll, pitch and yaw, rad."""
    roll, pitch, yaw = angles
    about_y_and_x = multiply(exp((0.0, pitch, 0.0)), exp((roll, 0.0, 0.0)))
    return multiply(exp((0.0, 0.0, yaw)), about_y_and_x)


def angles_of(q: Quaternion) -> list[float]:
    """Return roll, pitch and yaw of a unit quaternion, rad; straight up and down too.

    >>> [round(math.degrees(one), 3) for one in angles_of(of_angles((0.0, -math.pi / 2, 1.0)))]
    [0.0, -90.0, 57.296]
    """
    w, x, y, z = q
    level = math.hypot(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
    pitch = math.atan2(2.0 * (w * y - x * z), level)
    if level < _POLE:
        return [0.0, pitch, math.atan2(2.0 * (w * z - x * y), 1.0 - 2.0 * (x * x + z * z))]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return [roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))]


@dataclass(frozen=True, slots=True)
class Wish:
    """A request to the gimbal; NaN leaves a value as it is.

    Attributes:
        flags: of the message.
        angles: roll, pitch and yaw, rad.
        rates: of these angles, rad/s.  With its angle, a rate is the speed at which to reach it.
    """

    flags: int
    angles: Sequence[float] = UNSET
    rates: Sequence[float] = UNSET

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
    def problem(self) -> str:
        """Why it cannot be carried out by any gimbal, in one line; empty if it can."""
        both = YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME
        if self.flags & both == both:
            return (
                "a yaw in the frames of the vehicle and of the earth at once is denied: set one of "
                "the flags"
            )
        for kind, values in (("angle", self.angles), ("rate", self.rates)):
            if any(map(math.isinf, values)):
                return f"an infinite {kind} is denied: expected a number, or NaN for no change"
        return ""


def level(flags: int, angles: tuple[float, float], rates: tuple[float, float]) -> Wish:
    """Return the wish for pitch and yaw.  With an angle it levels the roll, else the roll stays."""
    roll = math.nan if all(map(math.isnan, angles)) else 0.0
    return Wish(flags, (roll, *angles), (math.nan, *rates))


def wish_of(message: Any) -> Wish | None:  # noqa: ANN401 - pymavlink has no types
    """Return the wish of a message that sets an attitude; ``None`` if its norm is wrong.

    Args:
        message: for the manager or the device of a gimbal; not of sticks.
    """
    if hasattr(message, "q"):
        angles = attitude(message.q)
        names = ("angular_velocity_x", "angular_velocity_y", "angular_velocity_z")
        rates = [getattr(message, name) for name in names]
        return None if angles is None else Wish(message.flags, angles, rates)
    return level(
        message.flags, (message.pitch, message.yaw), (message.pitch_rate, message.yaw_rate)
    )


def attitude(q: Sequence[float]) -> Sequence[float] | None:
    """Return roll, pitch and yaw, NaN if a component is; ``None`` if *q* is not of unit norm."""
    size = math.hypot(*q)
    if math.isnan(size):
        return UNSET
    if abs(size - 1.0) > TYPED_NORM_TOLERANCE:
        return None
    w, x, y, z = q
    return angles_of(normalize((w, x, y, z)))


class Setpoint:
    """The commanded attitude, and the path on which it moves to its goals.

    Each angle moves to its goal with bounded speed and acceleration, and brakes in time.  So it
    does not pass a goal that stays where it is.  An angle that turns at a rate has an infinite
    goal.

    Attributes:
        base: roll, pitch and heading of the gimbal's base, or of the vehicle that carries it, in
            the earth frame, rad; the heading is 0 if it is unknown.
        flags: those that apply.
    """

    def __init__(self, heading: float, *, speed: float, acceleration: float) -> None:
        """Look forward, level.

        Args:
            heading: of a level base, until another attitude of it is known, rad.
            speed: largest speed of an angle without a rate of its own, rad/s.
            acceleration: of an angle, rad/s^2.
        """
        self.base: Sequence[float] = (0.0, 0.0, heading)
        self.flags = ROLL_LOCK | PITCH_LOCK
        self._speed, self._acceleration = speed, acceleration
        self._angles, self._rates, self._goals = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self._speeds = [speed] * 3

    @property
    def is_moving(self) -> bool:
        """Whether an angle is not at its goal."""
        return self._angles != self._goals

    def begin(self, q: Quaternion) -> None:
        """Stand still at an orientation ``(w, x, y, z)`` of the tool in the base frame."""
        turned = multiply(of_angles(self.base), mirrored(q))
        self._goals = angles_of(multiply(conjugate(self._frame()), turned))
        self.settle()

    def settle(self) -> None:
        """Stand still at the goals."""
        self._angles, self._rates = list(self._goals), [0.0] * 3

    def take(self, wish: Wish, gap: float = 0.0) -> None:
        """Take over the request of a message; an unset angle keeps its last setpoint.

        Args:
            wish: the request.
            gap: usual time between two messages of a stream, s.  An angle without a rate then moves
                evenly from message to message.
        """
        if wish.flags & NEUTRAL:
            wish = Wish(NEUTRAL | ROLL_LOCK | PITCH_LOCK, (0.0, 0.0, 0.0))
        is_turning = [math.isinf(goal) for goal in self._goals]
        last = [a if math.isinf(b) else b for a, b in zip(self._angles, self._goals, strict=True)]
        before = self._frame()
        asked = _frame(self.base, wish.flags, wish.is_from_north)
        self.flags = wish.flags
        after = self._frame()
        self._angles = _seen(before, self._angles, after)
        last = _seen(before, last, asked)
        new = [old if math.isnan(one) else one for old, one in zip(last, wish.angles, strict=True)]
        for k, goal in enumerate(_seen(asked, new, after)):
            angle, rate = self._angles[k], wish.rates[k]
            has_rate = bool(rate) and not math.isnan(rate)
            is_unset = math.isnan(wish.angles[k])
            left = math.remainder(goal - angle, math.tau)
            self._speeds[k] = abs(rate) if has_rate else self._speed
            self._goals[k] = angle + left
            if is_unset and has_rate:
                self._goals[k] = math.copysign(math.inf, rate)
            elif is_unset and (rate == 0.0 or is_turning[k]):
                self._brake(k)
            elif gap and not has_rate:
                self._speeds[k] = min(self._speed, abs(left) / (_AHEAD * gap))

    def rest(self) -> bool:
        """Let every angle that turns at a rate come to rest; return whether there is one."""
        turning = [k for k, goal in enumerate(self._goals) if math.isinf(goal)]
        for k in turning:
            self._brake(k)
        return bool(turning)

    def advance(self, seconds: float) -> None:
        """Move the angles."""
        while seconds > 0.0:
            for k in range(3):
                self._step(k, min(seconds, STEP))
            seconds -= STEP

    def ahead(self, count: int) -> list[Quaternion]:
        """Return the next orientations of the tool in the base frame, :data:`STEP` s apart."""
        path, poses = copy.deepcopy(self), []
        for _ in range(count):
            poses.append(path.orientation())
            path.advance(STEP)
        return poses

    def orientation(self) -> Quaternion:
        """Return the orientation ``(w, x, y, z)`` of the tool in the base frame."""
        turn = multiply(self._frame(), of_angles(self._angles))
        return mirrored(multiply(conjugate(of_angles(self.base)), turn))

    def _frame(self) -> Quaternion:
        return _frame(self.base, self.flags, bool(self.flags & YAW_LOCK))

    def _brake(self, k: int) -> None:
        """Let an angle come to rest from its present rate."""
        rate = self._rates[k]
        way = 0.5 * rate * abs(rate) / (_BRAKE * self._acceleration)
        self._goals[k], self._speeds[k] = self._angles[k] + way, self._speed

    def _step(self, k: int, seconds: float) -> None:
        """Move an angle, for a short time."""
        left, change = self._goals[k] - self._angles[k], self._acceleration * seconds
        if abs(left) <= abs(self._rates[k]) * seconds and abs(self._rates[k]) <= 2.0 * change:
            self._angles[k], self._rates[k] = self._goals[k], 0.0
            return
        fastest = math.sqrt(2.0 * _BRAKE * self._acceleration * abs(left))
        wanted = math.copysign(min(self._speeds[k], fastest), left)
        self._rates[k] += max(-change, min(change, wanted - self._rates[k]))
        self._angles[k] += self._rates[k] * seconds


def _frame(base: Sequence[float], flags: int, is_from_north: bool) -> Quaternion:
    """Return the frame of the angles, relative to the earth.

    Roll and pitch are relative to the horizon if locked, else to the base.  The yaw is relative to
    north, or to the heading of the base.
    """
    roll, pitch, heading = base
    return of_angles(
        (
            0.0 if flags & ROLL_LOCK else roll,
            0.0 if flags & PITCH_LOCK else pitch,
            0.0 if is_from_north else heading,
        )
    )


def _seen(frame: Quaternion, angles: Sequence[float], other: Quaternion) -> list[float]:
    """Return the angles relative to *other* of an attitude relative to *frame*."""
    return angles_of(multiply(conjugate(other), multiply(frame, of_angles(angles))))
