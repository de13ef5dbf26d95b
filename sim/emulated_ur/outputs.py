"""The RTDE outputs that follow from the controller's state; the others keep their values."""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from operator import attrgetter
from typing import TYPE_CHECKING

from emulated_ur.arm import speed
from emulated_ur.variables import ProgramState, RobotMode, Value

if TYPE_CHECKING:
    from emulated_ur.controller import Controller

_JOINT_MODES = {RobotMode.RUNNING: 253, RobotMode.IDLE: 255, RobotMode.POWER_ON: 255}
_POWERED_OFF = 239


def _status_bits(robot: Controller) -> int:
    is_running = robot.runtime_state not in (ProgramState.STOPPED, ProgramState.STOPPING)
    return int(robot.robot_mode >= RobotMode.POWER_ON) | int(is_running) << 1


def _pose(name: str) -> Callable[[Controller], Value]:
    return lambda robot: robot.tool.pose(name)


def _elbow(robot: Controller) -> tuple[float, ...]:
    return robot.arm.kinematics.frames(robot.arm.actual_q)[1][3::4]


def _elbow_velocity(robot: Controller) -> tuple[float, ...]:
    chain = robot.arm.kinematics.frames(robot.arm.actual_q)[:2]
    return speed(chain, robot.arm.actual_qd[:2], chain[1][3::4])[:3]


COMPUTED: dict[str, Callable[[Controller], Value]] = {
    **{name: attrgetter(name) for name in ("timestamp", "robot_mode", "safety_mode",
                                           "safety_status", "runtime_state")},
    **{name: attrgetter(f"arm.{name}")
       for name in ("target_q", "target_qd", "target_qdd", "actual_q", "actual_qd")},
    **{name: _pose(name)
       for name in ("actual_TCP_pose", "actual_TCP_speed", "target_TCP_pose", "target_TCP_speed")},
    "robot_status_bits": _status_bits,
    "safety_status_bits": attrgetter("safety.bits"),
    "speed_scaling": attrgetter("speed_limiter"),
    "target_speed_fraction": attrgetter("speed_fraction"),
    "tcp_offset": attrgetter("tool.offset"),
    "actual_TCP_force": attrgetter("force"),
    "tcp_force_scalar": lambda robot: hypot(*robot.force[:3]),
    "elbow_position": _elbow,
    "elbow_velocity": _elbow_velocity,
    "script_control_line": lambda robot: robot.program.line if robot.program else 0,
    "joint_mode": lambda robot: (_JOINT_MODES.get(robot.robot_mode, _POWERED_OFF),) * 6,
}  # fmt: skip
"""The function of each output."""
