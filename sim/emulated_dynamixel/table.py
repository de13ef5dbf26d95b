"""Control tables of the emulated servos, from ``registers.txt`` and ``models.txt``."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

EEPROM_END = 64
TICKS_PER_TURN = 4096
CENTRE = 2048

VELOCITY_UNIT = 0.229 * 2 * math.pi / 60
"""rad/s of one step of a velocity register."""
ACCELERATION_UNIT = 214.577 * 2 * math.pi / 3600
"""rad/s^2 of one step of the profile acceleration."""

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
MODES = (0, 1, 3, 4, 5, 16)


_STORED = {
    (size, is_signed): struct.Struct("<" + (letter.lower() if is_signed else letter))
    for size, letter in ((1, "B"), (2, "H"), (4, "I"))
    for is_signed in (False, True)
}
"""How a register is stored, by its size in bytes and whether it is signed."""


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
        writable: whether it is writable.
    """

    name: str
    address: int
    size: int
    default: int
    low: int
    high: int
    writable: bool

    @property
    def is_signed(self) -> bool:
        """Whether it is read as two's complement."""
        return self.low < 0


@dataclass(frozen=True)
class ServoModel:
    """One servo model.

    Attributes:
        name: as printed on it.
        number: its answer to a ping.
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

    @cached_property
    def end(self) -> int:
        """The first address beyond the table."""
        return max(block + count for _, block, count in self.indirect)

    @cached_property
    def named(self) -> Mapping[str, Register]:
        """The registers by name."""
        return {register.name: register for register in self.registers.values()}

    @cached_property
    def places(self) -> Mapping[str, tuple[struct.Struct, int]]:
        """How each register is stored, and its address, by name."""
        return {
            register.name: (_STORED[register.size, register.is_signed], register.address)
            for register in self.registers.values()
        }


_INDIRECT = (((168, 224, 28), (578, 634, 28)), ((168, 208, 20),))
_VOLTAGE = (120, 50)
"""Of the two families."""


def _rows(file: str) -> Iterator[str]:
    text = Path(__file__).with_name(file).read_text(encoding="utf-8")
    return (line for line in text.splitlines() if line and not line.startswith("#"))


def _register(row: str, family: int, instead: Mapping[str, str]) -> Register:
    *fields, name = row.split(maxsplit=6)
    picked = (field.split("|")[-1 if family else 0] for field in fields)
    address, size, access, default, low, high = picked
    value = int(instead.get(name, default))
    return Register(name, int(address), int(size), value, int(low), int(high), access == "rw")


def _model(row: str) -> tuple[str, ServoModel]:
    short, name, number, family_, rpm, velocity_limit = row.split()
    family = int(family_)
    instead = {"model number": number, "velocity limit": velocity_limit}
    registers = [_register(each, family, instead) for each in _rows("registers.txt")]
    areas = _INDIRECT[family]
    last = max(block + count for _, block, count in areas) - 1
    registers += [
        Register(
            f"indirect address {block + k}", addresses + 2 * k, 2, block + k, EEPROM_END, last, True
        )
        for addresses, block, count in areas
        for k in range(count)
    ]
    table = {register.address: register for register in registers}
    speed = float(rpm) * 2 * math.pi / 60
    return short, ServoModel(name, int(number), table, areas, speed, _VOLTAGE[family])


MODELS: Mapping[str, ServoModel] = dict(map(_model, _rows("models.txt")))
"""The models by the short names of the command line."""
XM430_W350, XL330_M288 = MODELS["xm430"], MODELS["xl330"]
