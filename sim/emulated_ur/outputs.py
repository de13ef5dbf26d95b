"""How each RTDE output variable is read from the controller."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from operator import attrgetter
from typing import TYPE_CHECKING

from emulated_ur.arm import speed
from emulated_ur.variables import OUTPUTS, REGISTERS, ProgramState, RobotMode, SafetyMode
from emulated_ur.wire import TYPES, Value

if TYPE_CHECKING:
    from emulated_ur.controller import Controller

Getter = Callable[["Controller"], Value]

_STOPPED = 1 << 10
_SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.REDUCED: 1 << 0 | 1 << 1,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | _STOPPED,
    SafetyMode.RECOVERY: 1 << 3,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | _STOPPED,
    SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | 1 << 7 | _STOPPED,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | _STOPPED,
    SafetyMode.VIOLATION: 1 << 8 | _STOPPED,
    SafetyMode.FAULT: 1 << 9 | _STOPPED,
}
_JOINT_MODES = {RobotMode.RUNNING: 253, RobotMode.IDLE: 255, RobotMode.POWER_ON: 255}
_POWERED_OFF = 239


def _status_bits(robot: Controller) -> int:
    is_running = robot.runtime_state not in (ProgramState.STOPPED, ProgramState.STOPPING)
    return int(robot.robot_mode >= 4) | int(is_running) << 1


def _constant(value: Value) -> Getter:
    return lambda _robot: value


def _pose(name: str) -> Getter:
    return lambda robot: robot.tool.pose(name)


def _register(kind: str, number: int) -> Getter:
    return lambda robot: getattr(robot, kind)[number]


def _bits(kind: str, first: int, count: int) -> Getter:
    return lambda robot: getattr(robot, f"{kind}_bits") >> first & (1 << count) - 1


def _elbow(robot: Controller) -> tuple[float, ...]:
    return robot.arm.kinematics.frames(robot.arm.actual_q)[1][3::4]


def _elbow_velocity(robot: Controller) -> tuple[float, ...]:
    chain = robot.arm.kinematics.frames(robot.arm.actual_q)[:2]
    return speed(chain, robot.arm.actual_qd[:2], chain[1][3::4])[:3]


def _nothing(kind: str) -> Value:
    code, width = TYPES[kind]
    zero = 0.0 if code.endswith("d") else 0
    return zero if width == 1 else (zero,) * width


def _getters() -> dict[str, Getter]:
    # What an arm without motors, sensors or a cabinet has to say: nothing happens.
    getters = {name: _constant(_nothing(kind)) for name, kind in OUTPUTS.items()}
    for number in range(REGISTERS):
        for kind in ("input", "output"):
            getters[f"{kind}_int_register_{number}"] = _register(f"{kind}_ints", number)
            getters[f"{kind}_double_register_{number}"] = _register(f"{kind}_doubles", number)
    for kind in ("input", "output"):
        getters[f"{kind}_bit_registers0_to_31"] = _bits(kind, 0, 32)
        getters[f"{kind}_bit_registers32_to_63"] = _bits(kind, 32, 32)
        for number in range(64, 128):
            getters[f"{kind}_bit_register_{number}"] = _bits(kind, number, 1)
    for name in ("actual_TCP_pose", "actual_TCP_speed", "target_TCP_pose", "target_TCP_speed"):
        getters[name] = _pose(name)
    for name in ("target_q", "target_qd", "target_qdd", "actual_q", "actual_qd"):
        getters[name] = attrgetter(f"arm.{name}")
    for name in ("timestamp", "payload", "payload_cog", "payload_inertia"):
        getters[name] = attrgetter(name)
    getters |= {
        "robot_mode": lambda robot: int(robot.robot_mode),
        "safety_mode": lambda robot: int(robot.safety_mode),
        "safety_status": lambda robot: int(robot.safety_status),
        "runtime_state": lambda robot: int(robot.runtime_state),
        "robot_status_bits": _status_bits,
        "safety_status_bits": lambda robot: _SAFETY_BITS[robot.safety_mode],
        "speed_scaling": lambda robot: robot.speed_limiter,
        "target_speed_fraction": lambda robot: robot.speed_fraction,
        "tcp_offset": lambda robot: robot.tool.offset,
        "actual_digital_output_bits": lambda robot: robot.digital_outputs,
        "actual_digital_input_bits": lambda robot: robot.digital_inputs,
        "standard_analog_input0": lambda robot: robot.analog_inputs[0],
        "standard_analog_input1": lambda robot: robot.analog_inputs[1],
        "tool_analog_input0": lambda robot: robot.analog_inputs[2],
        "tool_analog_input1": lambda robot: robot.analog_inputs[3],
        "standard_analog_output0": lambda robot: robot.analog_outputs[0],
        "standard_analog_output1": lambda robot: robot.analog_outputs[1],
        "analog_io_types": lambda robot: robot.analog_types,
        "actual_TCP_force": lambda robot: robot.force,
        "tcp_force_scalar": lambda robot: hypot(*robot.force[:3]),
        "elbow_position": _elbow,
        "elbow_velocity": _elbow_velocity,
        "script_control_line": lambda robot: robot.program.line if robot.program else 0,
        "tool_output_voltage": lambda robot: robot.tool_voltage,
        "tool_mode": _constant(253),
        "tool_temperature": _constant(28.0),
        "joint_mode": lambda robot: (_JOINT_MODES.get(robot.robot_mode, _POWERED_OFF),) * 6,
        "joint_temperatures": _constant((28.0,) * 6),
        "actual_main_voltage": _constant(48.0),
        "actual_robot_voltage": _constant(48.0),
        "actual_joint_voltage": _constant((48.0,) * 6),
        "actual_tool_accelerometer": _constant((0.0, 0.0, -9.82)),
    }
    return getters


OUTPUT_GETTERS: dict[str, Getter] = _getters()
