"""Supervision of running servos: faults, held axes in a fault, and health.

A servo with its torque on moves to its goal as soon as an obstacle comes free.  So the goal of a
failed axis becomes its own position at once, while the others brake on the path.  At rest, all of
them are read again. Only accepted positions become goals.  An axis without one keeps its goal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import FollowCheck, PartHealth
from orientd_dynamixel.bus import ServoBus, sendable
from orientd_dynamixel.group import Reading
from orientd_dynamixel.servo import PARK_RATE, Servo
from orientd_dynamixel.tables import VOLT, WATCHDOG_TRIPPED, explain_error

_KEPT = math.radians(0.5)
"""A goal this close to the position is kept: the load hangs on the difference."""
_FAR = math.radians(1.0)
"""Distance beyond which an axis does not merely lag behind its goal."""
_SETTLING_NS = 100_000_000
"""Time at rest after which an axis no longer lags behind its goal."""

_HEAT_MARGIN = 10
"""K below the temperature at which a servo shuts down."""
_VOLTAGE_MARGIN = 0.04
"""Share of the voltages at which a servo reports an error."""
_CURRENT_SHARE = 0.9
"""Share of the largest current; if held for long, the servo shuts down."""
_LONG = 3
"""Readings in a row with a current that large."""


def complain(servo: Servo, reading: Reading, follow: FollowCheck, now_ns: int) -> str:
    """Return what is wrong with a servo, as read at *now_ns*, or an empty string."""
    if reading.hardware_error:
        return f"{servo} reports {explain_error(reading.hardware_error)}"
    if reading.watchdog == WATCHDOG_TRIPPED:
        return f"{servo} stopped because nothing was sent for too long"
    if not reading.torque:
        return f"{servo} has lost its torque"
    return follow.problem(servo.angle(servo.goal) - servo.angle(reading.position), now_ns)


class Standing:
    """The held axes, and their goals.

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
        """Hold the axis at *place* at its last known position; return whether that is new."""
        if place in self.goals:
            return False
        servo = self._servos[place]
        self.goals[place] = servo.goal if servo.position is None else sendable(servo.position)
        return True

    def rest(self, now_ns: int) -> None:
        """Hold all axes from now on, each at its present position; repeat if called again."""
        places = range(len(self._servos))
        self._pending = {n for n in places if self.is_at_rest or n not in self.goals}
        self.is_at_rest, self._since_ns = True, now_ns

    def stands(self, place: int, now_ns: int) -> bool:
        """Return whether the axis at *place* already stands, and does not merely lag behind."""
        return place in self.goals or (self.is_at_rest and now_ns - self._since_ns > _SETTLING_NS)

    def send(self, bus: ServoBus) -> None:
        """Send the goals of axes at rest, after slow profiles in case one still moves.

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
        """Make the servo's position its goal, if it was read since and differs."""
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


def judge(servo: Servo, reading: Reading, time_ns: int) -> PartHealth:
    """Return the condition of a servo, as read at *time_ns*, with developing problems."""
    options, bears, unit = servo.options, servo.bears, servo.options.model.current_unit
    hot, volt = reading.temperature, VOLT * reading.voltage
    current = abs(reading.current) * unit
    # An axis that speeds up needs the full current for a moment.
    servo.strained = servo.strained + 1 if current >= _CURRENT_SHARE * bears.current > 0.0 else 0
    found = {
        f"has {hot} degrees C, at {bears.temperature} it gives up":
            hot >= bears.temperature - _HEAT_MARGIN,
        f"has {volt:.1f} V, below {bears.lowest:.1f} V it reports an error":
            volt <= bears.lowest * (1.0 + _VOLTAGE_MARGIN),
        f"has {volt:.1f} V, above {bears.highest:.1f} V it reports an error":
            volt >= bears.highest * (1.0 - _VOLTAGE_MARGIN),
        f"needs {current:.2f} A for long, {bears.current:.2f} A is its limit":
            servo.strained >= _LONG,
    }  # fmt: skip
    problems = " and ".join(text for text, is_true in found.items() if is_true)
    return PartHealth(
        options.name, time_ns, volt, float(hot), reading.current * unit if unit else None,
        f"{servo} {problems}" if problems else "",
    )  # fmt: skip
