"""What running servos report: faults, what the axes do in one, and how the servos are.

A servo whose torque is on goes to its goal as soon as what holds it lets go.  So an axis that has
failed gets its own position as its goal at once, while the others are braked on the path; when they
are at rest, all of them are looked at again.  Only positions that are believed become goals: an
axis of which nothing is believed keeps the goal that it has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from orientd.driver import PartHealth
from orientd_dynamixel.bus import ServoBus, sendable
from orientd_dynamixel.group import Group, Health, Reading
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.servo import PARK_RATE, Servo
from orientd_dynamixel.tables import VOLT, WATCHDOG_TRIPPED, explain_error

_KEPT = math.radians(0.5)
"""A goal this close to the position is kept: the load hangs on the difference."""
_FAR = math.radians(1.0)
"""Farther away than this, an axis does not merely lag behind its goal."""
_SETTLING_NS = 100_000_000
"""After this time at rest an axis no longer lags behind its goal."""

_HEAT_MARGIN = 10.0
"""K below the temperature at which a servo gives up."""
_VOLTAGE_MARGIN = 0.04
"""Share of the voltages at which a servo reports an error."""
_CURRENT_SHARE = 0.9
"""Of the current at which it gives no more; held for long it gives up."""
_LONG = 3
"""Looks in a row at which the current is that large."""


def complain(servo: Servo, reading: Reading, options: GimbalOptions, now_ns: int) -> str:
    """Return what is wrong with a servo, as it was read at *now_ns*, or nothing."""
    if reading.hardware_error:
        return f"{servo} reports {explain_error(reading.hardware_error)}"
    if reading.watchdog == WATCHDOG_TRIPPED:
        return f"{servo} stopped because nothing was sent for too long"
    if not reading.torque:
        return f"{servo} has lost its torque"
    apart = abs(servo.angle(reading.position) - servo.angle(servo.goal))
    if apart <= options.follow_tolerance:
        servo.apart_ns = 0
    elif not servo.apart_ns:
        servo.apart_ns = now_ns
    elif now_ns - servo.apart_ns > options.follow_time * 1e9:
        return (
            f"{servo} does not follow: it is {math.degrees(apart):.1f} deg behind for more than "
            f"{options.follow_time:g} s; is it jammed or overloaded?"
        )
    return ""


class Standing:
    """The axes that stand, and their goals.

    Attributes:
        goals: ticks, by the axis' place.
        is_at_rest: whether no axis follows the path any more.
    """

    def __init__(self, servos: Sequence[Servo]) -> None:
        self.goals: dict[int, int] = {}
        self.is_at_rest = False
        self._servos = servos
        self._pending: set[int] = set()
        self._since_ns = 0

    def fail(self, place: int) -> bool:
        """Let the axis at *place* stand where it was last seen; return whether that is new."""
        if place in self.goals:
            return False
        servo = self._servos[place]
        self.goals[place] = servo.goal if servo.position is None else sendable(servo.position)
        return True

    def rest(self, now_ns: int) -> None:
        """Let all axes stand, each where it is found to be from now on; again if asked again."""
        places = range(len(self._servos))
        self._pending = {n for n in places if self.is_at_rest or n not in self.goals}
        self.is_at_rest, self._since_ns = True, now_ns

    def stands(self, place: int, now_ns: int) -> bool:
        """Return whether the axis at *place* stands by now, and does not merely lag behind."""
        return place in self.goals or (self.is_at_rest and now_ns - self._since_ns > _SETTLING_NS)

    def send(self, bus: ServoBus) -> None:
        """Send the goals of axes at rest, after slow profiles, should one move all the same.

        Raises:
            LinkError: the port is gone.
        """
        for place in list(self._pending):
            self._look(place)
        for place, goal in self.goals.items():
            self._servos[place].goal = goal
        slow = [(s.options.id, s.table.profile_velocity, s.steps(PARK_RATE)) for s in self._servos]
        bus.sync_write(slow)
        bus.sync_write([(s.options.id, s.table.goal, s.goal) for s in self._servos])

    def _look(self, place: int) -> None:
        """Take where the servo stands as its goal, if it was seen since and is not there."""
        servo = self._servos[place]
        if servo.position is None or servo.seen_ns <= self._since_ns:
            return
        apart = abs(servo.angle(servo.position) - servo.angle(servo.goal))
        is_settled = servo.seen_ns - self._since_ns > _SETTLING_NS
        if apart > (_KEPT if is_settled else _FAR):
            self.goals[place] = sendable(servo.position)
        elif not is_settled:
            return
        self._pending.remove(place)


@dataclass(slots=True)
class Condition:
    """The condition of one servo against what it switches itself off for.

    Attributes:
        servo: which one.
        temperature: the highest that it bears, as its own settings say; degrees Celsius.
        lowest: voltage, V.
        highest: voltage, V.
        current: A; 0 if it does not measure it.
        strained: looks in a row at which the current was large.
    """

    servo: Servo
    temperature: int
    lowest: float
    highest: float
    current: float
    strained: int = 0

    @classmethod
    def ask(cls, servo: Servo) -> Condition:
        """Ask a servo for what it bears."""
        table, unit = servo.table, servo.options.model.current_unit
        lowest, highest = (VOLT * servo.get(one) for one in (table.min_voltage, table.max_voltage))
        current = unit * servo.get(table.current_limit) if unit else 0.0
        return cls(servo, servo.get(table.temperature_limit), lowest, highest, current)

    def judge(self, health: Health, reading: Reading) -> PartHealth:
        """Return how the servo is, with what is soon to go wrong."""
        unit = self.servo.options.model.current_unit
        current = reading.current * unit if unit else None
        # An axis that speeds up needs all the current there is for a moment.
        is_large = current is not None and abs(current) >= _CURRENT_SHARE * self.current
        self.strained = self.strained + 1 if is_large else 0
        hot, volt = health.temperature, health.voltage
        found = {
            f"has {hot:.0f} degrees C, at {self.temperature} it gives up":
                hot >= self.temperature - _HEAT_MARGIN,
            f"has {volt:.1f} V, below {self.lowest:.1f} V it reports an error":
                volt <= self.lowest * (1.0 + _VOLTAGE_MARGIN),
            f"has {volt:.1f} V, above {self.highest:.1f} V it reports an error":
                volt >= self.highest * (1.0 - _VOLTAGE_MARGIN),
            f"needs {abs(current or 0.0):.2f} A for long, {self.current:.2f} A is its limit":
                self.strained >= _LONG,
        }  # fmt: skip
        problems = " and ".join(text for text, is_true in found.items() if is_true)
        warning = f"{self.servo} {problems}" if problems else ""
        name = self.servo.options.name
        return PartHealth(name, health.time_ns, volt, hot, current, warning)


class Conditions:
    """The condition of all servos of a gimbal."""

    def __init__(self, servos: Sequence[Servo]) -> None:
        """Ask the servos for what they bear."""
        self._conditions = [Condition.ask(servo) for servo in servos]
        self._told: tuple[PartHealth, ...] = ()

    def judge(self, group: Group) -> tuple[PartHealth, ...]:
        """Return how every servo is, as *group* has last read it; empty before that."""
        is_new = group.health and [h.time_ns for h in group.health] != [
            p.time_ns for p in self._told
        ]
        if is_new and group.readings:
            looked = zip(self._conditions, group.health, group.readings, strict=True)
            self._told = tuple(one.judge(health, reading) for one, health, reading in looked)
        return self._told
