"""The variables a UR controller exchanges over RTDE: names, types, and the enumerations.

Names and types are those of UR's RTDE guide; what older software lacks is in :func:`is_known`, and
asking for it is answered with ``NOT_FOUND``, as for a name that there is not.
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
    """What the safety system allows; the last two are a ``safety_status`` alone."""

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


_OUTPUTS = """
DOUBLE timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum
DOUBLE actual_main_voltage actual_robot_voltage actual_robot_current standard_analog_input0
DOUBLE standard_analog_input1 standard_analog_output0 standard_analog_output1 io_current
DOUBLE euromap67_24V_voltage euromap67_24V_current tool_analog_input0 tool_analog_input1
DOUBLE tool_output_current tool_temperature tcp_force_scalar joint_position_deviation_ratio
DOUBLE collision_detection_ratio payload actual_robot_energy_consumed
DOUBLE actual_robot_braking_energy_dissipated
VECTOR6D target_q target_qd target_qdd target_current target_moment actual_q actual_qd
VECTOR6D actual_current actual_current_window joint_control_output actual_TCP_pose
VECTOR6D actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed joint_temperatures
VECTOR6D actual_joint_voltage ft_raw_wrench wrench_calc_from_currents payload_inertia tcp_offset
VECTOR6D actual_current_as_torque
VECTOR3D actual_tool_accelerometer elbow_position elbow_velocity payload_cog
VECTOR6INT32 joint_mode
UINT64 actual_digital_input_bits actual_digital_output_bits
INT32 robot_mode safety_mode safety_status tool_output_voltage time_scale_source encoder0_raw
INT32 encoder1_raw
UINT32 runtime_state robot_status_bits safety_status_bits analog_io_types euromap67_input_bits
UINT32 euromap67_output_bits tool_mode tool_analog_input_types script_control_line
UINT8 tool_output_mode tool_digital_output0_mode tool_digital_output1_mode
"""
_INPUTS = """
UINT32 speed_slider_mask
DOUBLE speed_slider_fraction standard_analog_output_0 standard_analog_output_1
UINT8 standard_digital_output_mask standard_digital_output configurable_digital_output_mask
UINT8 configurable_digital_output tool_digital_output_mask tool_digital_output
UINT8 standard_analog_output_mask standard_analog_output_type
VECTOR6D external_force_torque
"""


def _registers(kind: str) -> dict[str, str]:
    return {
        f"{kind}_bit_registers0_to_31": "UINT32",
        f"{kind}_bit_registers32_to_63": "UINT32",
        **{f"{kind}_bit_register_{n}": "BOOL" for n in range(64, 128)},
        **{f"{kind}_int_register_{n}": "INT32" for n in range(REGISTERS)},
        **{f"{kind}_double_register_{n}": "DOUBLE" for n in range(REGISTERS)},
    }


def _table(text: str) -> dict[str, str]:
    lines = (line.split() for line in text.strip().splitlines())
    return {name: kind for kind, *names in lines for name in names}


OUTPUTS = {**_table(_OUTPUTS), **_registers("output"), **_registers("input")}
INPUTS = {**_table(_INPUTS), **_registers("input")}

# First version of CB3 and of all others, where it is known; None where CB3 never had it.
_SINCE: dict[str, tuple[tuple[int, ...] | None, tuple[int, ...]]] = {
    "tcp_offset": ((3, 12), (5, 5, 1)),
    "payload": ((3, 11), (5, 5, 1)),
    "payload_cog": ((3, 11), (5, 5, 1)),
    "payload_inertia": ((3, 15), (5, 11)),
    "script_control_line": ((3, 14), (5, 9)),
    "ft_raw_wrench": (None, (5, 9)),
    "collision_detection_ratio": (None, (5, 15)),
    "time_scale_source": (None, (5, 17)),
    "actual_current_as_torque": (None, (5, 23)),
    "actual_robot_energy_consumed": (None, (5, 23)),
    "actual_robot_braking_energy_dissipated": (None, (5, 23)),
}


def is_known(name: str, version: tuple[int, ...]) -> bool:
    """Whether a controller with this *version* knows the output variable *name*."""
    if name not in OUTPUTS:
        return False
    first = _SINCE.get(name, ((0,), (0,)))[version[0] >= 5]
    return first is not None and version >= first
