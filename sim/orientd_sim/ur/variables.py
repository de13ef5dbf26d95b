"""The variables a UR controller exchanges over RTDE: names, types, and the enumerations.

Names and types are those of UR's RTDE guide for PolyScope 5.12; variables that came later are
absent, so that asking for them answers ``NOT_FOUND`` as such a controller does.  What older
software lacks is in :func:`is_known`.
"""

from __future__ import annotations

from enum import IntEnum

REGISTERS = 48


class ProgramState(IntEnum):
    """What the program is doing."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


class RobotMode(IntEnum):
    """How far the arm is from running."""

    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7


class SafetyMode(IntEnum):
    """What the safety system allows."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


_VECTORS = (
    "target_q",
    "target_qd",
    "target_qdd",
    "target_current",
    "target_moment",
    "actual_q",
    "actual_qd",
    "actual_current",
    "joint_control_output",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "target_TCP_pose",
    "target_TCP_speed",
    "joint_temperatures",
    "actual_joint_voltage",
    "ft_raw_wrench",
    "payload_inertia",
)
_DOUBLES = (
    "timestamp",
    "actual_execution_time",
    "speed_scaling",
    "target_speed_fraction",
    "actual_momentum",
    "actual_main_voltage",
    "actual_robot_voltage",
    "actual_robot_current",
    "standard_analog_input0",
    "standard_analog_input1",
    "standard_analog_output0",
    "standard_analog_output1",
    "payload",
)

OUTPUTS: dict[str, str] = {
    **dict.fromkeys(_VECTORS, "VECTOR6D"),
    **dict.fromkeys(_DOUBLES, "DOUBLE"),
    "actual_digital_input_bits": "UINT64",
    "actual_digital_output_bits": "UINT64",
    "robot_mode": "INT32",
    "joint_mode": "VECTOR6INT32",
    "safety_mode": "INT32",
    "safety_status": "INT32",
    "actual_tool_accelerometer": "VECTOR3D",
    "payload_cog": "VECTOR3D",
    "tcp_offset": "VECTOR6D",
    "runtime_state": "UINT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    **{f"output_int_register_{n}": "INT32" for n in range(REGISTERS)},
    **{f"output_double_register_{n}": "DOUBLE" for n in range(REGISTERS)},
    **{f"input_int_register_{n}": "INT32" for n in range(REGISTERS)},
    **{f"input_double_register_{n}": "DOUBLE" for n in range(REGISTERS)},
}

INPUTS: dict[str, str] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    **{f"input_int_register_{n}": "INT32" for n in range(REGISTERS)},
    **{f"input_double_register_{n}": "DOUBLE" for n in range(REGISTERS)},
}

# First version of CB3 and of all others; None where CB3 never had it.
_SINCE: dict[str, tuple[tuple[int, ...] | None, tuple[int, ...]]] = {
    "tcp_offset": ((3, 12), (5, 5, 1)),
    "payload": ((3, 11), (5, 5, 1)),
    "payload_cog": ((3, 11), (5, 5, 1)),
    "ft_raw_wrench": (None, (5, 9)),
}


def is_known(name: str, version: tuple[int, ...]) -> bool:
    """Whether a controller with this *version* knows the output variable *name*."""
    if name not in OUTPUTS:
        return False
    first = _SINCE.get(name, ((0,), (0,)))[version[0] >= 5]
    return first is not None and version >= first
