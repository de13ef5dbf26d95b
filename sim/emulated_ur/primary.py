"""The messages of the primary and secondary interfaces, as bytes; no sockets here.

Big endian, as in UR's "Client Interfaces" for 5.9: a message is ``i32 size, u8 type`` and its
contents.  A robot state consists of sub-packages with the same header.
"""

from __future__ import annotations

import struct

from emulated_ur.arm import TWISTS
from emulated_ur.controller import Controller, Event
from emulated_ur.variables import ProgramState, RobotMode, SafetyMode

EVERY_TICKS = 50
"""Ticks from one message to the next."""

_ROBOT_STATE, _ROBOT_MESSAGE, _VERSION = 16, 20, 3
_RUNNING_JOINT = 253
_FASTEST_CHANGE = 40.0  # rad/s^2, of every joint


def version_message(robot: Controller) -> bytes:
    """Return the greeting message."""
    major, minor, bugfix, build = robot.behaviour.version
    name, date = b"URControl", b"13-10-2022, 12:00:00"
    contents = struct.pack(">QbbB", round(robot.timestamp * 1e6), -2, _VERSION, len(name)) + name
    return _framed(
        _ROBOT_MESSAGE, contents + struct.pack(">BBii", major, minor, bugfix, build) + date
    )


def event_message(robot: Controller, event: Event) -> bytes:
    """Return the message about an event: a program's text, its start, its end, its exception."""
    kinds = {"text": (0, ""), "popup": (2, "II3B"), "key": (7, "ii"), "exception": (10, "ii")}
    if event.kind not in kinds:
        return b""
    number, form = kinds[event.kind]
    title = event.title.encode()[:255]
    has_title = event.kind in ("popup", "key")
    before = {"popup": (0, 0), "key": (0, 0)}.get(event.kind, ())
    return _framed(
        _ROBOT_MESSAGE,
        struct.pack(
            f">QbB{form}", round(robot.timestamp * 1e6), -2, number, *before, *event.numbers
        )
        + (bytes([len(title)]) + title if has_title else b"")
        + event.text.encode(),
    )


def state_message(robot: Controller, *, is_first: bool) -> bytes:
    """Return the robot's state; a client's first one also describes the arm."""
    parts = [
        _framed(0, _mode(robot)),
        _framed(1, _joints(robot)),
        _framed(2, struct.pack(">BBddfBffB", 0, 0, 0.0, 0.0, 0.0, 0, 0.0, 28.0, _RUNNING_JOINT)),
        _framed(3, _masterboard(robot)),
        _framed(4, struct.pack(">12d", *robot.tool.pose("actual_TCP_pose"), *robot.tool.offset)),
    ]
    if is_first:
        parts += [_framed(5, _kinematics(robot)), _framed(6, _configuration(robot))]
    return _framed(_ROBOT_STATE, b"".join(parts))


def _framed(kind: int, contents: bytes) -> bytes:
    return struct.pack(">iB", 5 + len(contents), kind) + contents


def _mode(robot: Controller) -> bytes:
    safety, state = robot.safety_mode, robot.runtime_state
    stops = (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP)
    return struct.pack(
        ">Q7?BBdddB",
        round(robot.timestamp * 1e6),
        True,
        True,
        robot.robot_mode >= RobotMode.POWER_ON,
        safety in stops,
        safety is SafetyMode.PROTECTIVE_STOP,
        state is ProgramState.PLAYING,
        state is ProgramState.PAUSED,
        robot.robot_mode,
        0,
        robot.speed_slider,
        robot.speed_scaling,
        1.0,
        0,
    )


def _joints(robot: Controller) -> bytes:
    arm = robot.arm
    return b"".join(
        struct.pack(">3d4fB", q, target, rate, 0.0, 48.0, 28.0, 28.0, _RUNNING_JOINT)
        for q, target, rate in zip(arm.actual_q, arm.target_q, arm.actual_qd, strict=True)
    )


def _masterboard(robot: Controller) -> bytes:
    analog = (robot.variables[f"standard_analog_output{port}"] for port in (0, 1))
    return struct.pack(
        ">IIBBddBBddffffBBBIBB",
        robot.variables["actual_digital_input_bits"], robot.variables["actual_digital_output_bits"],
        0, 0, 0.0, 0.0, 0, 0, *analog,
        28.0, 48.0, 0.5, 0.0, robot.safety_mode, robot.safety_mode is SafetyMode.REDUCED,
        0, 0, 0, 0,
    )  # fmt: skip


def _kinematics(robot: Controller) -> bytes:
    model = robot.arm.model
    table = (*(0.0,) * 6, *model.a, *model.d, *TWISTS)
    return struct.pack(">6I24dI", *(0,) * 6, *table, 0)


def _configuration(robot: Controller) -> bytes:
    model = robot.arm.model
    limits = [value for most in model.ranges for value in (-min(most, 1e9), min(most, 1e9))]
    motion = [value for speed in model.speeds for value in (speed, _FASTEST_CHANGE)]
    table = (*model.a, *model.d, *TWISTS, *(0.0,) * 6)
    return struct.pack(
        ">12d12d5d24d4i", *limits, *motion, 1.05, 1.4, 0.5, 1.2, 0.3, *table, 2, 0, model.kind, 0
    )
