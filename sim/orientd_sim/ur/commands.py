"""The commands of the control script: their numbers, and what each does to the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from enum import IntEnum
from typing import TYPE_CHECKING

from orientd_sim.ur.transforms import from_pose, multiply, rotation_between, to_pose

if TYPE_CHECKING:
    from orientd_sim.ur.script import ControlScript

Path = Callable[[float], tuple[float, ...]]

STOP_DECELERATION = 10.0


class Command(IntEnum):
    """What the integer command register may hold."""

    NONE = 0
    MOVE_J = 1
    MOVE_J_IK = 2
    MOVE_L = 3
    MOVE_L_FK = 4
    FORCE_MODE = 6
    SPEED_J = 9
    SPEED_L = 10
    SERVO_J = 11
    SPEED_STOP = 15
    SERVO_STOP = 16
    SET_PAYLOAD = 17
    SERVO_L = 24
    TOOL_CONTACT = 25
    STEP_TIME = 26
    JOINT_HISTORY = 27
    TARGET_WAYPOINT = 28
    SET_TCP = 29
    INVERSE_NEAR = 30
    PROTECTIVE_STOP = 31
    STOP_L = 33
    STOP_J = 34
    SET_WATCHDOG = 35
    IS_POSE_SAFE = 36
    ARE_JOINTS_SAFE = 37
    JOINT_TORQUES = 38
    POSE_PRODUCT = 39
    TCP_OFFSET = 40
    FORWARD = 43
    FORWARD_OF = 44
    INVERSE = 46
    IS_STEADY = 47
    FREEDRIVE_STATUS = 54
    FLANGE_POSE = 58
    SET_GRAVITY = 59
    HAS_INVERSE = 60
    HAS_INVERSE_NEAR = 61
    SET_TARGET_PAYLOAD = 65
    STOP_SCRIPT = 255


REAL_TIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})
"""Commands that are carried out at every tick they stay, and never answered with done."""


def execute_now(script: ControlScript, number: int) -> None:
    """Carry out a command that takes no time."""
    robot = script.robot
    if number == Command.SERVO_L:
        pose, (time, lookahead, gain) = script.numbers(0, 6), script.numbers(8, 3)
        script.start_servo(robot.tool.joints_at(pose), time, lookahead, gain)
    elif number == Command.SERVO_J:
        q, (time, lookahead, gain) = script.numbers(0, 6), script.numbers(8, 3)
        script.start_servo(q, time, lookahead, gain)
    elif number in (Command.SPEED_J, Command.SPEED_L):
        script.start_speed(script.numbers(0, 6), script.numbers(6, 1)[0], number == Command.SPEED_L)
    elif number == Command.STEP_TIME:
        script.answer((0.002,))
    elif number == Command.TOOL_CONTACT:
        script.answer_int(1, 0)
    elif number == Command.JOINT_HISTORY:
        script.answer(robot.arm.actual_q)
    elif number == Command.JOINT_TORQUES:
        script.answer((0.0,) * 6)
    elif number == Command.FLANGE_POSE:
        script.answer(to_pose(robot.tool.actual_flange()))


def execute(script: ControlScript, number: int) -> Generator[None, None, None]:
    """Carry out a command that is answered with done; yield once a tick while it lasts."""
    robot = script.robot
    if number in (Command.MOVE_J, Command.MOVE_J_IK, Command.MOVE_L, Command.MOVE_L_FK):
        yield from _move(script, number)
    elif number in (Command.SERVO_STOP, Command.SPEED_STOP, Command.STOP_L, Command.STOP_J):
        script.end_thread()
        robot.arm.brake(script.numbers(0, 1)[0])
        while not robot.arm.is_still:
            yield
    elif number == Command.SET_WATCHDOG:
        robot.set_watchdog(script.command_register, script.numbers(0, 1)[0])
    elif number == Command.PROTECTIVE_STOP:
        robot.protective_stop("asked for by the program")
    elif number in (Command.SET_PAYLOAD, Command.SET_TARGET_PAYLOAD):
        robot.payload = script.numbers(0, 1)[0]
        robot.payload_cog = script.numbers(1, 3)
        if number == Command.SET_TARGET_PAYLOAD:
            robot.payload_inertia = script.numbers(4, 6)
    elif number == Command.SET_TCP:
        robot.tool.offset = script.numbers(0, 6)
    elif number == Command.SET_GRAVITY:
        robot.gravity = script.numbers(0, 3)
    else:
        _compute(script, number)


def _compute(script: ControlScript, number: int) -> None:
    """Answer a question; commands the emulator does not know are answered by silence."""
    robot = script.robot
    if number == Command.TCP_OFFSET:
        script.answer(robot.tool.offset)
    elif number == Command.FORWARD:
        script.answer(to_pose(robot.tool.at(robot.arm.actual_q)))
    elif number == Command.FORWARD_OF:
        script.answer(to_pose(robot.tool.at(script.numbers(0, 6))))
    elif number == Command.TARGET_WAYPOINT:
        script.answer(to_pose(robot.tool.at(robot.arm.target_q)))
    elif number in (Command.INVERSE, Command.INVERSE_NEAR):
        near = script.numbers(6, 6) if number == Command.INVERSE_NEAR else None
        script.answer(robot.tool.joints_at(script.numbers(0, 6), near))
    elif number in (Command.HAS_INVERSE, Command.HAS_INVERSE_NEAR, Command.IS_POSE_SAFE):
        script.answer_int(1, int(robot.tool.find_joints(script.numbers(0, 6)) is not None))
    elif number == Command.ARE_JOINTS_SAFE:
        script.answer_int(1, int(all(abs(q) <= math.tau for q in script.numbers(0, 6))))
    elif number == Command.POSE_PRODUCT:
        a, b = from_pose(script.numbers(0, 6)), from_pose(script.numbers(6, 6))
        script.answer(to_pose(multiply(a, b)))
    elif number == Command.IS_STEADY:
        script.answer_int(1, int(robot.arm.is_still))
    elif number == Command.FREEDRIVE_STATUS:
        script.answer_int(1, 0)


def _move(script: ControlScript, number: int) -> Generator[None, None, None]:
    robot = script.robot
    target, (speed, acceleration) = script.numbers(0, 6), script.numbers(6, 2)
    start = robot.arm.target_q
    if number in (Command.MOVE_J, Command.MOVE_J_IK):
        goal = target if number == Command.MOVE_J else robot.tool.joints_at(target)
        length = max(abs(b - a) for a, b in zip(start, goal, strict=True))

        def along_joints(s: float) -> tuple[float, ...]:
            share = s / length
            return tuple(a + (b - a) * share for a, b in zip(start, goal, strict=True))

        yield from script.move(length, along_joints, speed, acceleration)
        return
    begin = robot.tool.at(start)
    end = from_pose(target)
    if number == Command.MOVE_L_FK:
        end = robot.tool.at(target)
    turn = rotation_between(begin, end)
    shift = (end[3] - begin[3], end[7] - begin[7], end[11] - begin[11])
    length = max(math.hypot(*shift), math.hypot(*turn))

    def along_line(s: float) -> tuple[float, ...]:
        share = s / length
        turned = multiply(from_pose((0.0, 0.0, 0.0, *(share * r for r in turn))), begin)
        at = tuple(p + share * d for p, d in zip(begin[3::4], shift, strict=True))
        placed = (*turned[0:3], at[0], *turned[4:7], at[1], *turned[8:11], at[2])
        return robot.tool.joints_at(to_pose(placed))

    yield from script.move(length, along_line, speed, acceleration)
