"""How each RTDE output variable is read from the controller."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING

from orientd_sim.ur.variables import OUTPUTS, REGISTERS, ProgramState, SafetyMode
from orientd_sim.ur.wire import TYPES, Value

if TYPE_CHECKING:
    from orientd_sim.ur.controller import Controller

Getter = Callable[["Controller"], Value]

_SAFETY_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.REDUCED: 1 << 0 | 1 << 1,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.RECOVERY: 1 << 3,
    SafetyMode.SAFEGUARD_STOP: 1 << 4 | 1 << 10,
    SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | 1 << 7 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
    SafetyMode.VIOLATION: 1 << 8 | 1 << 10,
    SafetyMode.FAULT: 1 << 9 | 1 << 10,
}


def _status_bits(robot: Controller) -> int:
    is_running = robot.runtime_state not in (ProgramState.STOPPED, ProgramState.STOPPING)
    return int(robot.robot_mode >= 4) | int(is_running) << 1


def _constant(value: Value) -> Getter:
    return lambda _robot: value


def _pose(name: str) -> Getter:
    return lambda robot: robot.tool.pose(name)


def _register(kind: str, number: int) -> Getter:
    return lambda robot: getattr(robot, kind)[number]


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
    for name in ("actual_TCP_pose", "actual_TCP_speed", "target_TCP_pose", "target_TCP_speed"):
        getters[name] = _pose(name)
    for name in ("target_q", "target_qd", "target_qdd", "actual_q", "actual_qd"):
        getters[name] = attrgetter(f"arm.{name}")
    for name in ("timestamp", "payload", "payload_cog", "payload_inertia"):
        getters[name] = attrgetter(name)
    getters |= {
        "robot_mode": lambda robot: int(robot.robot_mode),
        "safety_mode": lambda robot: int(robot.safety_mode),
        "safety_status": lambda robot: int(robot.safety_mode),
        "runtime_state": lambda robot: int(robot.runtime_state),
        "robot_status_bits": _status_bits,
        "safety_status_bits": lambda robot: _SAFETY_BITS[robot.safety_mode],
        "speed_scaling": lambda robot: robot.speed_limiter,
        "target_speed_fraction": lambda robot: robot.speed_fraction,
        "tcp_offset": lambda robot: robot.tool.offset,
        "actual_digital_output_bits": lambda robot: robot.digital_outputs,
        "standard_analog_output0": lambda robot: robot.analog_outputs[0],
        "standard_analog_output1": lambda robot: robot.analog_outputs[1],
        "joint_mode": _constant((253,) * 6),
        "joint_temperatures": _constant((28.0,) * 6),
        "actual_main_voltage": _constant(48.0),
        "actual_robot_voltage": _constant(48.0),
        "actual_joint_voltage": _constant((48.0,) * 6),
        "actual_tool_accelerometer": _constant((0.0, 0.0, -9.82)),
    }
    return getters


OUTPUT_GETTERS: dict[str, Getter] = _getters()
