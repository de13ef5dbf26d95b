"""A record of the clients' commands and the arm's motion, for bitwise comparison in tests.

Each line of the *setpoint* record is one servo command as received, each line of the *arm* record
one tick. Both are rows of fixed size in a file, described by the structs below.  All times are
nanoseconds of the machine's monotonic clock.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from pathlib import Path

from emulated_ur.controller import Controller
from emulated_ur.variables import Value

SETPOINT_ROW = struct.Struct("<qq6d")
"""Arrival of a servo command, its tick, and its six numbers, bit-exact."""

ARM_ROW = struct.Struct("<qq6d6d6d")
"""One tick: its time, the commanded pose, the measured pose, the measured joints."""

_SERVO_COMMANDS = (11, 24)


class Recording:
    """Count servo commands in the format of ``ur_rtde``, and keep rows until they are written.

    Attributes:
        is_on: whether rows are kept.
        setpoints: number of servo commands.
        overwritten: number of those followed by another one in the same tick.
    """

    def __init__(self) -> None:
        self.is_on = False
        self.setpoints = 0
        self.overwritten = 0
        self._this_tick = 0
        self.clear()

    def clear(self) -> None:
        """Discard every row."""
        self._setpoints = bytearray()
        self._arm = bytearray()

    def add_package(self, tick: int, names: Sequence[str], values: Sequence[Value]) -> None:
        """Count and keep a package of inputs, if it is a servo command."""
        is_recipe = len(values) == 12 and names[0].startswith("input_int_register_")
        if not is_recipe or values[0] not in _SERVO_COMMANDS:
            return
        self.setpoints += 1
        self.overwritten += self._this_tick == tick
        self._this_tick = tick
        if self.is_on:
            self._setpoints += SETPOINT_ROW.pack(time.monotonic_ns(), tick, *values[1:7])

    def add_tick(self, robot: Controller) -> None:
        """Keep the arm's motion in a tick."""
        if self.is_on:
            poses = robot.tool.pose("target_TCP_pose"), robot.tool.pose("actual_TCP_pose")
            numbers = (*poses[0], *poses[1], *robot.arm.actual_q)
            self._arm += ARM_ROW.pack(time.monotonic_ns(), robot.ticks, *numbers)

    def write(self, stem: Path) -> None:
        """Write ``STEM.setpoints`` and ``STEM.arm``."""
        stem.with_suffix(".setpoints").write_bytes(self._setpoints)
        stem.with_suffix(".arm").write_bytes(self._arm)
