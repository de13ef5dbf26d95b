"""The commands of the control script: their numbers, and what each does to the robot."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

from orientd_sim.ur.arm import from_pose, multiply, to_pose
from orientd_sim.ur.programs import (
    Ticks,
    UnknownStatementError,
    jog,
    move_joints,
    move_line,
    perform,
    stop,
    touch,
)

if TYPE_CHECKING:
    from orientd_sim.ur.script import ControlScript

STOP_DECELERATION = 10.0


class RegisterCommand(IntEnum):
    """What the integer command register may hold."""

    NONE = 0
    MOVE_J = 1
    MOVE_J_IK = 2
    MOVE_L = 3
    MOVE_L_FK = 4
    FORCE_MODE = 6
    FORCE_STOP = 7
    ZERO_FT = 8
    SPEED_J = 9
    SPEED_L = 10
    SERVO_J = 11
    SERVO_C = 12
    SPEED_STOP = 15
    SERVO_STOP = 16
    SET_PAYLOAD = 17
    TEACH_MODE = 18
    END_TEACH_MODE = 19
    FORCE_DAMPING = 20
    FORCE_GAIN = 21
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
    JOG_START = 41
    JOG_STOP = 42
    FORWARD = 43
    FORWARD_OF = 44
    MOVE_PATH = 45
    INVERSE = 46
    IS_STEADY = 47
    MOVE_UNTIL_CONTACT = 51
    FREEDRIVE = 52
    END_FREEDRIVE = 53
    FREEDRIVE_STATUS = 54
    FT_INPUT = 56
    FT_SENSOR = 57
    FLANGE_POSE = 58
    SET_GRAVITY = 59
    HAS_INVERSE = 60
    HAS_INVERSE_NEAR = 61
    CONTACT_START = 62
    CONTACT_END = 63
    CONTACT_READ = 64
    SET_TARGET_PAYLOAD = 65
    DIRECT_TORQUE = 66
    STOP_SCRIPT = 255


_MOTIONS = frozenset(
    {
        RegisterCommand.MOVE_J,
        RegisterCommand.MOVE_J_IK,
        RegisterCommand.MOVE_L,
        RegisterCommand.MOVE_L_FK,
        RegisterCommand.MOVE_PATH,
    }
)
_WITHOUT_EFFECT = frozenset(
    {
        RegisterCommand.ZERO_FT,
        RegisterCommand.FORCE_DAMPING,
        RegisterCommand.FORCE_GAIN,
        RegisterCommand.FT_INPUT,
        RegisterCommand.FT_SENSOR,
        RegisterCommand.CONTACT_START,
    }
)
"""What an arm without sensors has nothing to do for."""

REAL_TIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, *range(66, 72)})
"""Commands that are carried out at every tick they stay, and never answered with done."""


def execute_now(script: ControlScript, number: int) -> None:
    """Carry out a command that takes no time."""
    robot = script.robot
    if number in (RegisterCommand.SERVO_L, RegisterCommand.SERVO_J):
        goal, (time, lookahead, gain) = script.numbers(0, 6), script.numbers(8, 3)
        q = robot.tool.joints_at(goal) if number == RegisterCommand.SERVO_L else goal
        script.start_servo(q, time, lookahead, gain)
    elif number in (RegisterCommand.SPEED_J, RegisterCommand.SPEED_L):
        script.start_speed(
            script.numbers(0, 6), script.numbers(6, 1)[0], number == RegisterCommand.SPEED_L
        )
    elif number == RegisterCommand.STEP_TIME:
        script.answer((0.002,))
    elif number == RegisterCommand.FORCE_MODE:
        given = (script.numbers(0, 6), tuple(script.command_int(2 + axis) for axis in range(6)))
        script.start_force(*given, script.numbers(6, 6), script.numbers(12, 6))
    elif number == RegisterCommand.TOOL_CONTACT:
        script.answer_int(1, int(robot.is_touching))
    elif number == RegisterCommand.JOINT_HISTORY:
        script.answer(robot.arm.actual_q)
    elif number == RegisterCommand.JOINT_TORQUES:
        script.answer((0.0,) * 6)
    elif number == RegisterCommand.FLANGE_POSE:
        script.answer(to_pose(robot.arm.kinematics.forward(robot.arm.actual_q)))
    elif number == RegisterCommand.DIRECT_TORQUE:
        raise UnknownStatementError("direct_torque: needs PolyScope 5.23, and is not emulated")


def execute(script: ControlScript, number: int) -> Ticks:
    """Carry out a command that is answered with done; yield once a tick while it lasts."""
    robot = script.robot
    if number in _MOTIONS or number in (RegisterCommand.STOP_L, RegisterCommand.STOP_J):
        is_stop = number not in _MOTIONS
        script.end_move()
        motion = stop(robot, script.numbers(0, 1)[0]) if is_stop else _motion(script, number)
        if script.command_int(1) == 1:
            script.start_move(motion)
        else:
            yield from motion
    elif number in (
        RegisterCommand.SERVO_STOP,
        RegisterCommand.SPEED_STOP,
        RegisterCommand.JOG_STOP,
        RegisterCommand.FORCE_STOP,
    ):
        script.end_thread()
        own = number in (RegisterCommand.SERVO_STOP, RegisterCommand.SPEED_STOP)
        yield from stop(robot, script.numbers(0, 1)[0] if own else STOP_DECELERATION)
    elif number == RegisterCommand.JOG_START:
        script.start_thread(
            jog(robot, script.numbers(0, 6), _frame(script), script.numbers(7, 1)[0])
        )
    elif number == RegisterCommand.SERVO_C:
        pose, (speed, rate) = script.numbers(0, 6), script.numbers(6, 2)
        script.start_thread(move_line(robot, pose, speed, rate))
    elif number == RegisterCommand.MOVE_UNTIL_CONTACT:
        yield from touch(robot, script.numbers(0, 6), script.numbers(12, 1)[0])
    elif number in (RegisterCommand.TEACH_MODE, RegisterCommand.FREEDRIVE):
        robot.arm.free()
    elif number in (RegisterCommand.END_TEACH_MODE, RegisterCommand.END_FREEDRIVE):
        yield from stop(robot, STOP_DECELERATION)
    elif number == RegisterCommand.SET_WATCHDOG:
        robot.set_watchdog(script.command_register, script.numbers(0, 1)[0])
    elif number == RegisterCommand.PROTECTIVE_STOP:
        robot.protective_stop("asked for by the program")
    elif number in (RegisterCommand.SET_PAYLOAD, RegisterCommand.SET_TARGET_PAYLOAD):
        robot.payload = script.numbers(0, 1)[0]
        robot.payload_cog = script.numbers(1, 3)
        if number == RegisterCommand.SET_TARGET_PAYLOAD:
            robot.payload_inertia = script.numbers(4, 6)
    elif number == RegisterCommand.SET_TCP:
        robot.tool.offset = script.numbers(0, 6)
    elif number == RegisterCommand.SET_GRAVITY:
        robot.gravity = script.numbers(0, 3)
    else:
        _compute(script, number)


def _compute(script: ControlScript, number: int) -> None:
    """Answer a question.

    Raises:
        UnknownStatementError: the emulator does not know the command.
    """
    robot = script.robot
    if number == RegisterCommand.TCP_OFFSET:
        script.answer(robot.tool.offset)
    elif number == RegisterCommand.FORWARD:
        script.answer(to_pose(robot.tool.at(robot.arm.actual_q)))
    elif number == RegisterCommand.FORWARD_OF:
        script.answer(to_pose(robot.tool.at(script.numbers(0, 6))))
    elif number == RegisterCommand.TARGET_WAYPOINT:
        script.answer(to_pose(robot.tool.at(robot.arm.target_q)))
    elif number in (RegisterCommand.INVERSE, RegisterCommand.INVERSE_NEAR):
        near = script.numbers(6, 6) if number == RegisterCommand.INVERSE_NEAR else None
        script.answer(robot.tool.joints_at(script.numbers(0, 6), near))
    elif number in (
        RegisterCommand.HAS_INVERSE,
        RegisterCommand.HAS_INVERSE_NEAR,
        RegisterCommand.IS_POSE_SAFE,
    ):
        near = script.numbers(6, 6) if number == RegisterCommand.HAS_INVERSE_NEAR else None
        script.answer_int(1, int(robot.tool.find_joints(script.numbers(0, 6), near) is not None))
    elif number == RegisterCommand.ARE_JOINTS_SAFE:
        joints = zip(script.numbers(0, 6), robot.arm.model.ranges, strict=True)
        script.answer_int(1, int(all(abs(q) <= most for q, most in joints)))
    elif number == RegisterCommand.POSE_PRODUCT:
        a, b = from_pose(script.numbers(0, 6)), from_pose(script.numbers(6, 6))
        script.answer(to_pose(multiply(a, b)))
    elif number == RegisterCommand.IS_STEADY:
        script.answer_int(1, int(robot.arm.is_still))
    elif number in (
        RegisterCommand.FREEDRIVE_STATUS,
        RegisterCommand.CONTACT_END,
        RegisterCommand.CONTACT_READ,
    ):
        is_contact = number != RegisterCommand.FREEDRIVE_STATUS
        script.answer_int(1, int(is_contact and robot.is_touching))
    elif number not in _WITHOUT_EFFECT:
        raise UnknownStatementError(f"the control script's command {number} is not emulated")


def _motion(script: ControlScript, number: int) -> Ticks:
    robot = script.robot
    target, (speed, rate) = script.numbers(0, 6), script.numbers(6, 2)
    if number == RegisterCommand.MOVE_J:
        return move_joints(robot, target, speed, rate)
    if number == RegisterCommand.MOVE_J_IK:
        return move_joints(robot, robot.tool.joints_at(target), speed, rate)
    if number == RegisterCommand.MOVE_PATH:
        return perform(robot, script.path, script.tell_progress)
    return move_line(robot, target, speed, rate, is_joints=number == RegisterCommand.MOVE_L_FK)


def _frame(script: ControlScript) -> tuple[float, ...]:
    """Return the frame in which to jog: of the base, of the tool, or one that is given."""
    feature = round(script.numbers(6, 1)[0])
    if feature == 1:
        return script.robot.tool.pose("actual_TCP_pose")
    return script.numbers(8, 6) if feature == 2 else (0.0,) * 6
