"""Read what the emulated arm has recorded: servo commands as they came, ticks as they ran."""

from typing import NamedTuple

from emulated_ur.recording import ARM_ROW, SETPOINT_ROW


class SetpointRow(NamedTuple):
    time_ns: int
    tick: int
    target: tuple


class ArmRow(NamedTuple):
    time_ns: int
    tick: int
    target_pose: tuple
    actual_pose: tuple
    actual_q: tuple


def read_setpoints(stem):
    """Yield the servo commands of a record."""
    for row in SETPOINT_ROW.iter_unpack(stem.with_suffix(".setpoints").read_bytes()):
        yield SetpointRow(row[0], row[1], row[2:8])


def read_arm(stem):
    """Yield the ticks of a record."""
    for row in ARM_ROW.iter_unpack(stem.with_suffix(".arm").read_bytes()):
        yield ArmRow(row[0], row[1], row[2:8], row[8:14], row[14:20])
