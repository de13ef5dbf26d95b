"""How a servo is, against what it switches itself off for, in time to do something about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from orientd.driver import PartHealth
from orientd_dynamixel.axis import Axis
from orientd_dynamixel.bus import Group, Health, Reading, ServoBus

TEMPERATURE_LIMIT, MAX_VOLTAGE, MIN_VOLTAGE, CURRENT_LIMIT = 31, 32, 34, 38
VOLT = 0.1
"""V of one step of a voltage register."""

_HEAT_MARGIN = 10.0
"""K below the temperature at which a servo gives up."""
_VOLTAGE_MARGIN = 0.04
"""Share of the voltages at which a servo reports an error."""
_CURRENT_SHARE = 0.9
"""Of the current at which it gives no more; held for long it gives up."""
_LONG = 3
"""Looks in a row at which the current is that large."""
_RELEASE = 0.3
"""Part of a margin by which it must be better again."""


@dataclass(frozen=True, slots=True)
class Ratings:
    """What a servo bears, as its own settings say.

    Attributes:
        temperature: degrees Celsius.
        lowest: voltage, V.
        highest: voltage, V.
        current: A; 0 where it does not measure it.
    """

    temperature: float
    lowest: float
    highest: float
    current: float


def ratings(bus: ServoBus, axis: Axis) -> Ratings:
    """Ask a servo for what it bears."""
    servo, unit = axis.options.id, axis.options.model.current_unit
    return Ratings(
        bus.read(servo, TEMPERATURE_LIMIT, 1),
        VOLT * bus.read(servo, MIN_VOLTAGE, 2),
        VOLT * bus.read(servo, MAX_VOLTAGE, 2),
        unit * bus.read(servo, CURRENT_LIMIT, 2) if unit else 0.0,
    )


class Condition:
    """The condition of one servo, from look to look."""

    def __init__(self, axis: Axis, bears: Ratings) -> None:
        """Judge the servo of *axis* by what it *bears*."""
        self._axis = axis
        self._bears = bears
        self._warned: set[str] = set()
        self._strained = 0

    def judge(self, health: Health, reading: Reading) -> PartHealth:
        """Return how the servo is, with what is soon to go wrong."""
        options, bears = self._axis.options, self._bears
        unit = options.model.current_unit
        current = reading.current * unit if unit else None
        # An axis that speeds up needs all the current there is for a moment.
        is_large = current is not None and abs(current) >= _CURRENT_SHARE * bears.current
        self._strained = self._strained + 1 if is_large else 0
        low, high = _VOLTAGE_MARGIN * bears.lowest, _VOLTAGE_MARGIN * bears.highest
        found = {
            f"has {health.temperature:.0f} degrees C, at {bears.temperature:.0f} it gives up":
                self._is_near("hot", bears.temperature - health.temperature, _HEAT_MARGIN),
            f"has {health.voltage:.1f} V, below {bears.lowest:.1f} V it reports an error":
                self._is_near("low", health.voltage - bears.lowest, low),
            f"has {health.voltage:.1f} V, above {bears.highest:.1f} V it reports an error":
                self._is_near("high", bears.highest - health.voltage, high),
            f"needs {abs(current or 0.0):.2f} A for long, {bears.current:.2f} A is its limit":
                self._strained >= _LONG,
        }  # fmt: skip
        problems = " and ".join(text for text, is_true in found.items() if is_true)
        warning = f"servo {options.id} ({options.name}) {problems}" if problems else ""
        return PartHealth(
            options.name, health.time_ns, health.voltage, health.temperature, current, warning
        )

    def _is_near(self, what: str, room: float, margin: float) -> bool:
        """Return whether the *room* left is too small; once it was, it must be clearly larger."""
        is_small = room <= margin * (1.0 + _RELEASE * (what in self._warned))
        (self._warned.add if is_small else self._warned.discard)(what)
        return is_small


class Conditions:
    """The condition of all servos of a gimbal."""

    def __init__(self, bus: ServoBus | None = None, axes: Sequence[Axis] = ()) -> None:
        """Ask the servos of *axes* what they bear; without a *bus* there are none."""
        self._conditions = [Condition(a, ratings(bus, a)) for a in axes if bus is not None]
        self._told: tuple[PartHealth, ...] = ()
        self._measured_ns = 0

    def judge(self, group: Group) -> tuple[PartHealth, ...]:
        """Return how every servo is, as *group* has last read it; empty before that."""
        if group.health and group.readings and group.health[0].time_ns != self._measured_ns:
            self._measured_ns = group.health[0].time_ns
            read = zip(self._conditions, group.health, group.readings, strict=True)
            self._told = tuple(one.judge(health, reading) for one, health, reading in read)
        return self._told
