"""A record of what clients asked and what the arm did, for tests to compare bit by bit.

Each line of the *setpoint* record is one servo command as it came off the wire, each line of the
*arm* record one tick.  Both are rows of fixed size in a file, described by the structs below; all
times are nanoseconds of the machine's monotonic clock.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

from emulated_ur.wire import Value

SETPOINT_ROW = struct.Struct("<qq6d")
"""When a servo command arrived, in which tick, and its six numbers, bit-exact."""

ARM_ROW = struct.Struct("<qq6d6d6d")
"""One tick: when it ran, the pose commanded, the pose measured, the joints measured."""

_SERVO_COMMANDS = (11, 24)


def servo_target(names: Sequence[str], values: Sequence[Value]) -> tuple[float, ...] | None:
    """Return the six numbers of a servo command as ``ur_rtde`` writes it, or ``None``."""
    if len(values) != 12 or not names[0].startswith("input_int_register_"):
        return None
    if values[0] not in _SERVO_COMMANDS:
        return None
    return tuple(float(one) for one in values[1:7] if not isinstance(one, tuple))


class SetpointRecording:
    """Rows kept in memory until they are written out."""

    def __init__(self) -> None:
        self.is_on = False
        self._setpoints = bytearray()
        self._arm = bytearray()

    def clear(self) -> None:
        """Forget everything recorded."""
        self._setpoints.clear()
        self._arm.clear()

    def add_setpoint(self, time_ns: int, tick: int, target: tuple[float, ...]) -> None:
        """Keep one servo command."""
        self._setpoints += SETPOINT_ROW.pack(time_ns, tick, *target)

    def add_arm(
        self,
        time_ns: int,
        tick: int,
        target_pose: tuple[float, ...],
        actual_pose: tuple[float, ...],
        actual_q: tuple[float, ...],
    ) -> None:
        """Keep one tick."""
        self._arm += ARM_ROW.pack(time_ns, tick, *target_pose, *actual_pose, *actual_q)

    def write(self, stem: Path) -> None:
        """Write ``STEM.setpoints`` and ``STEM.arm``."""
        stem.with_suffix(".setpoints").write_bytes(self._setpoints)
        stem.with_suffix(".arm").write_bytes(self._arm)
