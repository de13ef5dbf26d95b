"""The RTDE variables of a UR controller, from ``variables.txt``, and their numbers.

A request for a variable that the controller's software lacks is answered with ``NOT_FOUND``, like
one for an unknown name.
"""

from __future__ import annotations

import re
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

Scalar = int | float
Value = Scalar | tuple[Scalar, ...]

TYPES: dict[str, tuple[str, int]] = {
    "BOOL": ("B", 1),
    "UINT8": ("B", 1),
    "UINT32": ("I", 1),
    "INT32": ("i", 1),
    "UINT64": ("Q", 1),
    "DOUBLE": ("d", 1),
    "VECTOR3D": ("3d", 3),
    "VECTOR6D": ("6d", 6),
    "VECTOR6INT32": ("6i", 6),
    "VECTOR6UINT32": ("6I", 6),
}
"""The format of a variable's type, and its number of values."""


class ProgramState(IntEnum):
    """State of the program."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class RobotMode(IntEnum):
    """State of the robot on the way to running."""

    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7


class SafetyMode(IntEnum):
    """State of the safety system; the last two are a ``safety_status`` only."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11
    AUTOMATIC_MODE_SAFEGUARD_STOP = 12
    SYSTEM_THREE_POSITION_ENABLING_STOP = 13


Version = tuple[int, ...]


class Since(NamedTuple):
    """The first software with a feature; ``None`` for a family without it."""

    cb3: Version | None = (0,)
    others: Version | None = (0,)

    def includes(self, version: Version) -> bool:
        """Whether a controller with this *version* has it."""
        first = self.cb3 if version[0] < 5 else self.others
        return first is not None and version >= first


class Variable(NamedTuple):
    """One variable: its type, the software that has it, and its initial value."""

    kind: str
    since: Since
    initial: Value
    is_output: bool
    is_input: bool


def _version(text: str) -> Version | None:
    return None if text == "-" else tuple(int(part) for part in text.split("."))


def _counted(name: str) -> list[str]:
    found = re.search(r"\{(\d+)\.\.(\d+)\}", name)
    if not found:
        return [name]
    first, last = map(int, found.groups())
    return [name.replace(found.group(), str(number)) for number in range(first, last + 1)]


def _read() -> dict[str, Variable]:
    variables: dict[str, Variable] = {}
    text = Path(__file__).with_name("variables.txt").read_text(encoding="utf-8")
    for line in text.splitlines():
        if not line or line.startswith("#"):
            continue
        direction, kind, cb3, others, value, *names = line.split()
        code, width = TYPES[kind]
        numbers = tuple((float if "d" in code else int)(part) for part in value.split(","))
        initial = numbers[0] if width == 1 else numbers * (width // len(numbers))
        since = Since(_version(cb3), _version(others))
        one = Variable(kind, since, initial, direction != "in", direction != "out")
        variables |= {name: one for each in names for name in _counted(each)}
    return variables


VARIABLES = _read()
"""Every variable by its name."""
