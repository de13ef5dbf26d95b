"""Models of servos and their registers, all as data: a new model is a row of :data:`MODELS`.

Addresses, units and speeds are from the vendor's manual, model numbers from its own tables.  None
was tried on a real servo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
"""Line speeds that both the servos and the vendor's SDK support."""

EXTENDED_POSITION, CURRENT_POSITION = 4, 5
"""Operating modes that count turns; the second one limits the current as well."""
RETURN_LEVEL = 2
"""The servo answers reads and writes."""
WATCHDOG_TRIPPED = 0xFF
TICK_RANGE = 32768
"""The servo's millisecond clock wraps here."""
VOLT = 0.1
"""V of one step of a voltage register."""
DELAY_US = 2
"""Microseconds of one step of the return delay."""

_HARDWARE_ERRORS = {
    0: "input voltage",
    2: "overheating",
    3: "encoder",
    4: "electrical shock",
    5: "overload",
}


def explain_error(bits: int) -> str:
    """Return what the bits of a hardware error mean."""
    return " and ".join(
        _HARDWARE_ERRORS.get(bit, f"error bit {bit}") for bit in range(8) if bits & 1 << bit
    )


class Register(NamedTuple):
    """One entry of a control table: its address, its size in bytes, whether it has a sign."""

    address: int
    size: int
    is_signed: bool = False


class ControlTable(NamedTuple):
    """The registers of the driver.  The defaults are those of the X and MX series."""

    return_delay: Register = Register(9, 1)
    drive_mode: Register = Register(10, 1)
    operating_mode: Register = Register(11, 1)
    homing_offset: Register = Register(20, 4, is_signed=True)
    temperature_limit: Register = Register(31, 1)
    max_voltage: Register = Register(32, 2)
    min_voltage: Register = Register(34, 2)
    current_limit: Register = Register(38, 2)
    velocity_limit: Register = Register(44, 4)
    torque: Register = Register(64, 1)
    return_level: Register = Register(68, 1)
    hardware_error: Register = Register(70, 1)
    watchdog: Register = Register(98, 1)
    goal_current: Register = Register(102, 2, is_signed=True)
    profile_acceleration: Register = Register(108, 4)
    profile_velocity: Register = Register(112, 4)
    goal: Register = Register(116, 4, is_signed=True)
    tick: Register = Register(120, 2)
    current: Register = Register(126, 2, is_signed=True)
    velocity: Register = Register(128, 4, is_signed=True)
    position: Register = Register(132, 4, is_signed=True)
    voltage: Register = Register(144, 2)
    temperature: Register = Register(146, 1)

    @property
    def block(self) -> tuple[int, ...]:
        """Addresses that are mapped together and read every cycle.

        The return level is among them because it is never 0.  A servo that has restarted has
        forgotten the map and answers with zeros, which would otherwise be a position.
        """
        return _addresses(
            self.torque, self.return_level, self.hardware_error, self.watchdog, self.tick,
            self.current, self.velocity, self.position,
        )  # fmt: skip

    @property
    def health(self) -> tuple[int, ...]:
        """Addresses that are mapped after the block, and read now and then."""
        return _addresses(self.voltage, self.temperature)


def _addresses(*registers: Register) -> tuple[int, ...]:
    return tuple(r.address + k for r in registers for k in range(r.size))


@dataclass(frozen=True, slots=True)
class Family:
    """Properties that several models share.

    Attributes:
        table: their registers.
        indirect_address: of the first entry of the map.
        indirect_data: address of the first mapped byte.
        fast_firmware: the first version with fast reads; ``None`` if unknown.
        velocity_unit: rad/s of one step.
        acceleration_unit: rad/s^2 of one step.
        centre: position in ticks at which an axis is at its zero.
        goal_limit: the farthest goal in either direction, ticks.
        permanent_end: registers below this address are permanent, and need the torque off.
        limits_current: whether there is the mode that counts turns and limits the current.
    """

    table: ControlTable
    indirect_address: int
    indirect_data: int
    fast_firmware: int | None
    velocity_unit: float
    acceleration_unit: float
    centre: int
    goal_limit: int
    permanent_end: int = 64
    limits_current: bool = True

    @property
    def forgets_map(self) -> bool:
        """Whether a restarted servo has forgotten the map."""
        return self.indirect_address >= self.permanent_end


_RPM = 2 * math.pi / 60
_RPM2 = 2 * math.pi / 3600
_X = ControlTable()
_P = ControlTable(*(r._replace(address=r.address + 448 * (r.address >= 64)) for r in _X))
"""In the P series all registers that are not permanent lie 448 bytes higher."""

X430 = Family(_X, 168, 224, 45, 0.229 * _RPM, 214.577 * _RPM2, 2048, 1_048_575)
X330 = Family(_X, 168, 208, 46, 0.229 * _RPM, 214.577 * _RPM2, 2048, 1_048_575)
MX2 = Family(_X, 168, 224, None, 0.229 * _RPM, 214.577 * _RPM2, 2048, 1_048_575)
P = Family(_P, 168, 634, None, 0.01 * _RPM, 1.0 * _RPM2, 0, 2**31 - 1, 512, limits_current=False)


@dataclass(frozen=True, slots=True)
class ServoModel:
    """The driver's data of a servo model.

    Attributes:
        name: as printed on it.
        number: its answer to a ping.
        family: its registers and units.
        no_load_rpm: turns a minute without load, at its nominal voltage.
        current_unit: A of one step; 0 if the servo does not measure its current.
        ticks: of one turn.
    """

    name: str
    number: int
    family: Family
    no_load_rpm: float
    current_unit: float
    ticks: int = 4096

    @property
    def no_load_speed(self) -> float:
        """The no-load speed in rad/s."""
        return self.no_load_rpm * _RPM

    @property
    def most_turns(self) -> int:
        """Whole turns that it counts, in either direction from its centre."""
        return self.family.goal_limit // self.ticks


MODELS: Mapping[str, ServoModel] = {
    "xm430": ServoModel("XM430-W350", 1020, X430, 46, 0.00269),
    "xm430-w210": ServoModel("XM430-W210", 1030, X430, 77, 0.00269),
    "xl330": ServoModel("XL330-M288", 1200, X330, 103, 0.001),
    "xm540-w270": ServoModel("XM540-W270", 1120, X430, 30, 0.00269),
    "xm540-w150": ServoModel("XM540-W150", 1130, X430, 53, 0.00269),
    "xw540-t260": ServoModel("XW540-T260", 1170, X430, 40, 0.00269),
    "xw540-t140": ServoModel("XW540-T140", 1180, X430, 72, 0.00269),
    "xl430-w250": ServoModel("XL430-W250", 1060, X430, 61, 0.0),
    "xc430-w240": ServoModel("XC430-W240", 1080, X430, 70, 0.0),
    "xc430-w150": ServoModel("XC430-W150", 1070, X430, 106, 0.0),
    "xl330-m077": ServoModel("XL330-M077", 1190, X330, 383, 0.001),
    "xc330-m181": ServoModel("XC330-M181", 1230, X330, 129, 0.001),
    "xc330-m288": ServoModel("XC330-M288", 1240, X330, 81, 0.001),
    "mx-28": ServoModel("MX-28(2.0)", 30, MX2, 55, 0.0),
    "mx-64": ServoModel("MX-64(2.0)", 311, MX2, 63, 0.00336),
    "mx-106": ServoModel("MX-106(2.0)", 321, MX2, 45, 0.00336),
    "ph42-020": ServoModel("PH42-020-S300", 2000, P, 32.7, 0.001, 607_500),
    "ph54-100": ServoModel("PH54-100-S500", 2010, P, 33.3, 0.001, 1_003_846),
    "ph54-200": ServoModel("PH54-200-S500", 2020, P, 33.1, 0.001, 1_003_846),
}
"""The models by the names of the option ``model``."""
