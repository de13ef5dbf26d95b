"""The motion of an emulated servo: profile, first-order lag, no-load speed, load and jam.

Positions are in ticks, unwrapped.  The model is integrated on access, in fixed steps, so the result
does not depend on the number of accesses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from emulated_dynamixel.table import TICKS_PER_TURN

STEP_NS = 2_000_000
LAG_S = 0.02
OVERLOAD_S = 1.0
TICKS_PER_RADIAN = TICKS_PER_TURN / (2 * math.pi)

_STEP_S = STEP_NS * 1e-9
_LAG_GAIN = 1 - math.exp(-_STEP_S / LAG_S)
_SETTLED_TICKS = 1e-6


@dataclass(slots=True)
class Aim:
    """The command of the electronics to the motor.

    Attributes:
        position: goal in ticks, or ``None`` for speed control.
        speed: goal in ticks/s, for speed control.
        profile_speed: ticks/s of the profile; 0 is a step.
        profile_acceleration: ticks/s^2 of the profile; 0 is infinite.
        speed_limit: ticks/s that the voltage allows.
        torque: usable share of the stall torque, above 0.
    """

    position: float | None = None
    speed: float = 0.0
    profile_speed: float = 0.0
    profile_acceleration: float = 0.0
    speed_limit: float = 0.0
    torque: float = 1.0


class Shaft:
    """The output shaft of one servo.

    Attributes:
        position: ticks, unwrapped since power-on.
        speed: ticks/s.
        reference: position of the profile, ticks.
        reference_speed: ticks/s.
        jammed: whether it is blocked.
        load: 0 turns freely, 1 stalls.
        strain_s: how long it has been stalled.
        stops: lowest and highest reachable position, ticks.
        trace: receives the position after every step of 2 ms; ``None`` for no record.
    """

    def __init__(self, position: float, now_ns: int) -> None:
        self.position = position
        self.speed = 0.0
        self.reference = position
        self.reference_speed = 0.0
        self.jammed = False
        self.load = 0.0
        self.strain_s = 0.0
        self.stops = (-math.inf, math.inf)
        self.trace: list[float] | None = None
        self._time_ns = now_ns
        self._turn_steps = 0

    def turn(self, ticks: float, seconds: float) -> None:
        """Turn by hand, a number of ticks in a time, while the motor is off."""
        self._turn_steps = max(1, round(seconds / _STEP_S))
        self.speed = ticks / (self._turn_steps * _STEP_S)

    def shift(self, ticks: float) -> None:
        """Shift the count of the position, and of the stops, by *ticks*."""
        low, high = self.stops
        self.position, self.stops = self.position + ticks, (low + ticks, high + ticks)
        self.settle()

    def _move(self) -> None:
        """Move by a step, no further than the stops."""
        low, high = self.stops
        self.position += self.speed * _STEP_S
        if not low <= self.position <= high:
            self.position, self.speed = min(high, max(low, self.position)), 0.0
        if self.trace is not None:
            self.trace.append(self.position)

    def settle(self) -> None:
        """Begin the next profile at rest, from where the shaft is."""
        self.reference = self.position
        self.reference_speed = 0.0

    def is_due(self, now_ns: int) -> bool:
        """Return whether a step ends by *now_ns*."""
        return self._time_ns + STEP_NS <= now_ns

    def advance(self, now_ns: int, aim: Aim | None) -> None:
        """Advance to *now_ns*, in whole steps; without *aim* the motor is off."""
        while self.is_due(now_ns):
            if self._is_settled(aim):
                self._time_ns += (now_ns - self._time_ns) // STEP_NS * STEP_NS
                return
            self._time_ns += STEP_NS
            self._step(aim)

    def _is_settled(self, aim: Aim | None) -> bool:
        if self.speed or self.strain_s:
            return False
        if aim is None:
            return True
        goal = aim.position
        return goal is not None and self.position == self.reference == goal

    def _step(self, aim: Aim | None) -> None:
        if aim is None:
            self.strain_s = 0.0
            self.speed = self.speed if self._turn_steps else 0.0
            self._move()
            self._turn_steps = max(0, self._turn_steps - 1)
            self.settle()
            return
        self._turn_steps = 0
        self._advance_reference(aim)
        limit = aim.speed_limit * max(0.0, 1.0 - self.load / max(aim.torque, 1e-9))
        if aim.position is None:
            wanted = self.speed + (self.reference_speed - self.speed) * _LAG_GAIN
        else:
            wanted = (self.reference - self.position) * _LAG_GAIN / _STEP_S
        low, high = self.stops
        is_blocked = (self.position <= low and wanted < 0) or (self.position >= high and wanted > 0)
        is_stalled = self.jammed or is_blocked or (limit <= 0.0 and wanted != 0.0)
        self.speed = 0.0 if self.jammed else min(limit, max(-limit, wanted))
        if is_stalled and abs(wanted) > 1.0:
            self.strain_s += _STEP_S
        else:
            self.strain_s = 0.0
        self._move()
        goal = aim.position
        if goal == self.reference and abs(goal - self.position) < _SETTLED_TICKS:
            self.position = goal
            self.speed = 0.0

    def _advance_reference(self, aim: Aim) -> None:
        acceleration = aim.profile_acceleration
        if aim.position is None:
            change = aim.speed - self.reference_speed
            most = acceleration * _STEP_S if acceleration else math.inf
            self.reference_speed += min(most, max(-most, change))
            self.reference = self.position
            return
        distance = aim.position - self.reference
        if not aim.profile_speed:
            self.reference, self.reference_speed = aim.position, 0.0
            return
        reach = aim.profile_speed
        if acceleration:
            # The speed from which the remaining distance is just enough to stop, one step ahead.
            half = acceleration * _STEP_S / 2
            reach = min(reach, math.sqrt(half * half + 2 * acceleration * abs(distance)) - half)
        wanted = math.copysign(reach, distance)
        most = acceleration * _STEP_S if acceleration else math.inf
        self.reference_speed += min(most, max(-most, wanted - self.reference_speed))
        step = self.reference_speed * _STEP_S
        if abs(step) >= abs(distance) and step * distance >= 0:
            self.reference, self.reference_speed = aim.position, 0.0
        else:
            self.reference += step
