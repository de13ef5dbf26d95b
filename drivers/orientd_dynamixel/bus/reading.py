"""What a servo reports every cycle, and whether to believe it."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

BLOCK = (64, 68, 70, 98, 120, 121, *range(126, 136))
"""Addresses that are mapped together: torque, return level, hardware error, watchdog, tick,
current, velocity, position.

The return level is there because it is never 0: a servo that has started again has forgotten the
map and answers with zeros, which would be a position.
"""
HEALTH = (144, 145, 146)
"""Addresses that are mapped after those: voltage and temperature, which are read now and then."""
RETURN_LEVEL = 2
WATCHDOG_TRIPPED = 0xFF
TICK_RANGE = 32768
REALTIME_TICK = 120
VELOCITY_UNIT = 0.229 * 2 * 3.141592653589793 / 60
"""rad/s of one step."""

_LAYOUT = struct.Struct("<BBBBHhii")
_HEALTH_LAYOUT = struct.Struct("<HB")

HARDWARE_ERRORS = {
    0: "input voltage",
    2: "overheating",
    3: "encoder",
    4: "electrical shock",
    5: "overload",
}


@dataclass(frozen=True, slots=True)
class Reading:
    """One block of one servo.

    Attributes:
        is_torque_on: whether it drives.
        has_map: whether the block is what was asked for.
        hardware_error: its bits.
        watchdog: in units of 20 ms, or :data:`WATCHDOG_TRIPPED`.
        tick_ms: its clock.
        current: in its own steps.
        velocity: rad/s of the servo.
        position: ticks, unwrapped by the servo.
    """

    is_torque_on: bool
    has_map: bool
    hardware_error: int
    watchdog: int
    tick_ms: int
    current: int
    velocity: float
    position: int


def decode(content: bytes) -> Reading:
    """Return what a block of :data:`BLOCK` says.

    Raises:
        ValueError: it has another length.
    """
    if len(content) != _LAYOUT.size:
        raise ValueError(f"a block must have {_LAYOUT.size} bytes, got {len(content)}")
    torque, level, error, watchdog, tick, current, velocity, position = _LAYOUT.unpack(content)
    return Reading(
        bool(torque), level == RETURN_LEVEL, error, watchdog, tick, current,
        velocity * VELOCITY_UNIT, position,
    )  # fmt: skip


class Health(NamedTuple):
    """What one servo reports now and then.

    Attributes:
        time_ns: when it was asked.
        voltage: of its supply, V.
        temperature: degrees Celsius.
    """

    time_ns: int
    voltage: float
    temperature: float


def decode_health(content: bytes, time_ns: int) -> Health:
    """Return what a block of :data:`HEALTH`, asked for at *time_ns*, says."""
    decivolts, temperature = _HEALTH_LAYOUT.unpack(content)
    return Health(time_ns, 0.1 * decivolts, float(temperature))


def explain_error(bits: int) -> str:
    """Return what the bits of a hardware error mean."""
    return " and ".join(
        HARDWARE_ERRORS.get(bit, f"error bit {bit}") for bit in range(8) if bits & 1 << bit
    )


def behind_ms(tick_ms: int, expected_ms: float) -> float:
    """Return by how much a servo's clock is behind what was expected, across its wrap."""
    return (expected_ms - tick_ms + TICK_RANGE / 2) % TICK_RANGE - TICK_RANGE / 2
