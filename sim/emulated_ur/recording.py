"""A record of what clients asked and what the arm did, for tests to compare bit by bit.

Each line of the *setpoint* record is one servo command as it came off the wire, each line of the
*arm* record one tick.  Both are rows of fixed size in a file, described by the structs below; all
times are nanoseconds of the machine's monotonic clock.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Sequence
from pathlib import Path

from emulated_ur.controller import Controller
from emulated_ur.variables import Value

SETPOINT_ROW = struct.Struct("<qq6d")
"""When a servo command arrived, in which tick, and its six numbers, bit-exact."""

ARM_ROW = struct.Struct("<qq6d6d6d")
"""One tick: when it ran, the pose commanded, the pose measured, the joints measured."""

_SERVO_COMMANDS = (11, 24)


class Recording:
    """Counts servo commands, as ``ur_rtde`` writes them, and keeps rows until they are written.

    Attributes:
        is_on: whether rows are kept.
        setpoints: servo commands so far.
        overwritten: those that another one followed in the same tick.
    """

    def __init__(self) -> None:
        self.is_on = False
        self.setpoints = 0
        self.overwritten = 0
        self._this_tick = 0
        self.clear()

    def clear(self) -> None:
        """Forget every row."""
        self._setpoints = bytearray()
        self._arm = bytearray()

    def add_package(self, tick: int, names: Sequence[str], values: Sequence[Value]) -> None:
        """Count a package of inputs, and keep it, if it is a servo command."""
        is_recipe = len(values) == 12 and names[0].startswith("input_int_register_")
        if not is_recipe or values[0] not in _SERVO_COMMANDS:
            return
        self.setpoints += 1
        self.overwritten += self._this_tick == tick
        self._this_tick = tick
        if self.is_on:
            self._setpoints += SETPOINT_ROW.pack(time.monotonic_ns(), tick, *values[1:7])

    def add_tick(self, robot: Controller) -> None:
        """Keep what the arm did in a tick."""
        if self.is_on:
            poses = robot.tool.pose("target_TCP_pose"), robot.tool.pose("actual_TCP_pose")
            numbers = (*poses[0], *poses[1], *robot.arm.actual_q)
            self._arm += ARM_ROW.pack(time.monotonic_ns(), robot.ticks, *numbers)

    def write(self, stem: Path) -> None:
        """Write ``STEM.setpoints`` and ``STEM.arm``."""
        stem.with_suffix(".setpoints").write_bytes(self._setpoints)
        stem.with_suffix(".arm").write_bytes(self._arm)
