"""Control tables of the servos that the emulator knows, from the ROBOTIS e-Manual."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

EEPROM_END = 64
TICKS_PER_TURN = 4096
CENTRE = 2048
TURN_LIMIT = 1_048_575
"""Largest goal position in the modes that count turns."""

VELOCITY_UNIT = 0.229 * 2 * math.pi / 60
"""rad/s of one step of a velocity register."""
ACCELERATION_UNIT = 214.577 * 2 * math.pi / 3600
"""rad/s^2 of one step of the profile acceleration."""

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
MODES = (0, 1, 3, 4, 5, 16)


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a control table.

    Attributes:
        name: as in the e-Manual, in lower case.
        address: of its first byte.
        size: in bytes.
        default: after a factory reset, or of the RAM after power-on.
        low: least value that can be written.
        high: largest value that can be written.
        writable: whether it can be written at all.
    """

    name: str
    address: int
    size: int
    default: int = 0
    low: int = 0
    high: int = 0
    writable: bool = True

    @property
    def is_signed(self) -> bool:
        """Whether it is read as two's complement."""
        return self.low < 0


@dataclass(frozen=True, slots=True)
class ServoModel:
    """One kind of servo.

    Attributes:
        name: as printed on it.
        number: what it answers to a ping.
        registers: by address.
        indirect: ``(address block, data block, count)`` of each indirect area.
        no_load_speed: rad/s at its nominal voltage; a loaded servo is slower.
        voltage: of its supply, in steps of 0.1 V.
    """

    name: str
    number: int
    registers: Mapping[int, Register]
    indirect: tuple[tuple[int, int, int], ...]
    no_load_speed: float
    voltage: int

    @property
    def end(self) -> int:
        """The first address beyond the table."""
        return max(block + count for _, block, count in self.indirect)

    def address(self, name: str) -> int:
        """Return the address of the register called *name*.

        Raises:
            KeyError: there is no such register.
        """
        for register in self.registers.values():
            if register.name == name:
                return register.address
        raise KeyError(name)


def _read_only(name: str, address: int, size: int, low: int = 0, default: int = 0) -> Register:
    return Register(name, address, size, default, low, 0, writable=False)


def _registers(
    number: int,
    firmware: int,
    *,
    baud_high: int,
    temperature: int,
    voltage: tuple[int, int, int, int],
    current: int,
    velocity: int,
    shutdown: int,
    gain: int,
    indirect: tuple[tuple[int, int, int], ...],
) -> Mapping[int, Register]:
    lowest, lowest_default, highest_default, highest = voltage
    last = max(block + count for _, block, count in indirect) - 1
    rows = [
        _read_only("model number", 0, 2, default=number),
        _read_only("model information", 2, 4),
        _read_only("firmware version", 6, 1, default=firmware),
        Register("id", 7, 1, 1, 0, 252),
        Register("baud rate", 8, 1, 1, 0, baud_high),
        Register("return delay time", 9, 1, 250, 0, 254),
        Register("drive mode", 10, 1, 0, 0, 13),
        Register("operating mode", 11, 1, 3, 0, 16),
        Register("secondary id", 12, 1, 255, 0, 255),
        Register("protocol type", 13, 1, 2, 1, 22),
        Register("homing offset", 20, 4, 0, -1_044_479, 1_044_479),
        Register("moving threshold", 24, 4, 10, 0, 1023),
        Register("temperature limit", 31, 1, temperature, 0, 100),
        Register("max voltage limit", 32, 2, highest_default, lowest, highest),
        Register("min voltage limit", 34, 2, lowest_default, lowest, highest),
        Register("pwm limit", 36, 2, 885, 0, 885),
        Register("current limit", 38, 2, current, 0, current),
        Register("velocity limit", 44, 4, velocity, 0, 2047),
        Register("max position limit", 48, 4, 4095, 0, 4095),
        Register("min position limit", 52, 4, 0, 0, 4095),
        Register("startup configuration", 60, 1, 0, 0, 3),
        Register("shutdown", 63, 1, shutdown, 0, 63),
        Register("torque enable", 64, 1, 0, 0, 1),
        Register("led", 65, 1, 0, 0, 1),
        Register("status return level", 68, 1, 2, 0, 2),
        _read_only("registered instruction", 69, 1),
        _read_only("hardware error status", 70, 1),
        Register("velocity i gain", 76, 2, 1920, 0, 16383),
        Register("velocity p gain", 78, 2, 100, 0, 16383),
        Register("position d gain", 80, 2, 0, 0, 16383),
        Register("position i gain", 82, 2, 0, 0, 16383),
        Register("position p gain", 84, 2, gain, 0, 16383),
        Register("feedforward 2nd gain", 88, 2, 0, 0, 16383),
        Register("feedforward 1st gain", 90, 2, 0, 0, 16383),
        Register("bus watchdog", 98, 1, 0, -1, 127),
        Register("goal pwm", 100, 2, 885, -885, 885),
        Register("goal current", 102, 2, current, -current, current),
        Register("goal velocity", 104, 4, 0, -2047, 2047),
        Register("profile acceleration", 108, 4, 0, 0, 32767),
        Register("profile velocity", 112, 4, 0, 0, 32767),
        Register("goal position", 116, 4, 0, -TURN_LIMIT, TURN_LIMIT),
        _read_only("realtime tick", 120, 2),
        _read_only("moving", 122, 1),
        _read_only("moving status", 123, 1),
        _read_only("present pwm", 124, 2, -1),
        _read_only("present current", 126, 2, -1),
        _read_only("present velocity", 128, 4, -1),
        _read_only("present position", 132, 4, -1),
        _read_only("velocity trajectory", 136, 4, -1),
        _read_only("position trajectory", 140, 4, -1),
        _read_only("present input voltage", 144, 2),
        _read_only("present temperature", 146, 1),
        _read_only("backup ready", 147, 1),
    ]
    for addresses, block, count in indirect:
        rows += [
            Register(f"indirect address {block + k}", addresses + 2 * k, 2, block + k, 64, last)
            for k in range(count)
        ]
    return {row.address: row for row in rows}


_XM430_INDIRECT = ((168, 224, 28), (578, 634, 28))
_XL330_INDIRECT = ((168, 208, 20),)

XM430_W350 = ServoModel(
    "XM430-W350", 1020,
    _registers(
        1020, 48, baud_high=7, temperature=80, voltage=(95, 95, 160, 160), current=1193,
        velocity=200, shutdown=52, gain=800, indirect=_XM430_INDIRECT,
    ),
    _XM430_INDIRECT, 46 * 2 * math.pi / 60, 120,
)  # fmt: skip
XL330_M288 = ServoModel(
    "XL330-M288", 1200,
    _registers(
        1200, 52, baud_high=6, temperature=70, voltage=(31, 35, 70, 70), current=1750,
        velocity=445, shutdown=53, gain=400, indirect=_XL330_INDIRECT,
    ),
    _XL330_INDIRECT, 103 * 2 * math.pi / 60, 50,
)  # fmt: skip


def _like(base: ServoModel, name: str, number: int, rpm: float) -> ServoModel:
    """Return a model that has the control table of *base*."""
    numbers = {
        0: Register("model number", 0, 2, number, writable=False),
        44: Register("velocity limit", 44, 4, math.ceil(rpm / 0.229), 0, 2047),
    }
    registers = {**base.registers, **numbers}
    speed = rpm * 2 * math.pi / 60
    return replace(base, name=name, number=number, registers=registers, no_load_speed=speed)


MODELS: Mapping[str, ServoModel] = {
    "xm430": XM430_W350,
    "xl330": XL330_M288,
    "xm540-w270": _like(XM430_W350, "XM540-W270", 1120, 30),
    "xm540-w150": _like(XM430_W350, "XM540-W150", 1130, 53),
    "xw540-t260": _like(XM430_W350, "XW540-T260", 1170, 40),
    "xw540-t140": _like(XM430_W350, "XW540-T140", 1180, 72),
    "xl430-w250": _like(XM430_W350, "XL430-W250", 1060, 61),
    "xc430-w240": _like(XM430_W350, "XC430-W240", 1080, 70),
    "xc330-m181": _like(XL330_M288, "XC330-M181", 1230, 129),
    "xc330-m288": _like(XL330_M288, "XC330-M288", 1240, 81),
    "mx-28": _like(XM430_W350, "MX-28(2.0)", 30, 55),
    "mx-64": _like(XM430_W350, "MX-64(2.0)", 311, 63),
    "mx-106": _like(XM430_W350, "MX-106(2.0)", 321, 45),
}
"""By the short names of the command line."""
