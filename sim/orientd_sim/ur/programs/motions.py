"""Motions of the arm as generators that yield once a tick, as ``sync()`` would in a program.

They are models: trapezoids of speed, no blending, and no forces but those that somebody asks for by
the control channel's ``contact``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING

from orientd_sim.ur.arm import TICK, from_pose, multiply, rotation_between, to_pose

if TYPE_CHECKING:
    from orientd_sim.ur.controller import Controller

Ticks = Generator[None, None, None]
Path = Callable[[float], tuple[float, ...]]

_YIELDING = (0.01, 0.01, 0.01, 0.5, 0.5, 0.5)
"""How fast the tool gives way to forces in force mode: m/s for each N, rad/s for each Nm."""


def move_joints(robot: Controller, goal: Sequence[float], speed: float, rate: float) -> Ticks:
    """Turn the joints to *goal*, all arriving together; rad/s and rad/s^2 of the one that leads."""
    start = robot.arm.target_q
    length = max(abs(b - a) for a, b in zip(start, goal, strict=True))

    def along_joints(s: float) -> tuple[float, ...]:
        share = s / length
        return tuple(a + (b - a) * share for a, b in zip(start, goal, strict=True))

    yield from _follow(robot, length, along_joints, speed, rate)


def move_line(
    robot: Controller, goal: Sequence[float], speed: float, rate: float, *, is_joints: bool = False
) -> Ticks:
    """Move the tool in a line to the pose *goal*, or to where the joints *goal* bring it."""
    begin = robot.tool.at(robot.arm.target_q)
    end = robot.tool.at(goal) if is_joints else from_pose(goal)
    turn = rotation_between(begin, end)
    shift = (end[3] - begin[3], end[7] - begin[7], end[11] - begin[11])
    length = max(math.hypot(*shift), math.hypot(*turn))

    def along_line(s: float) -> tuple[float, ...]:
        share = s / length
        turned = multiply(from_pose((0.0, 0.0, 0.0, *(share * r for r in turn))), begin)
        at = tuple(p + share * d for p, d in zip(begin[3::4], shift, strict=True))
        placed = (*turned[0:3], at[0], *turned[4:7], at[1], *turned[8:11], at[2])
        return robot.tool.joints_at(to_pose(placed))

    yield from _follow(robot, length, along_line, speed, rate)


def stop(robot: Controller, deceleration: float) -> Ticks:
    """Come to rest."""
    robot.arm.brake(deceleration)
    while not robot.arm.is_still:
        yield


def jog(
    robot: Controller, speeds: Sequence[float], frame: Sequence[float], acceleration: float
) -> Ticks:
    """Move the tool at *speeds* in *frame*, for ever."""
    wanted, rate = _turned(speeds, frame), [0.0] * 6
    step = max(acceleration, 1e-3) * TICK
    while True:
        rate = [r + max(-step, min(step, w - r)) for r, w in zip(rate, wanted, strict=True)]
        push(robot, rate)
        yield


def press(
    robot: Controller,
    frame: Sequence[float],
    selection: Sequence[int],
    wrench: Sequence[float],
    limits: Sequence[float],
) -> Ticks:
    """Give way along the selected axes of *frame*, until something is touched."""
    speeds = [
        max(-limit, min(limit, force * give)) if chosen else 0.0
        for chosen, force, limit, give in zip(selection, wrench, limits, _YIELDING, strict=True)
    ]
    while True:
        if robot.is_touching:
            robot.arm.follow(robot.arm.target_q)
        else:
            push(robot, _turned(speeds, frame))
        yield


def touch(robot: Controller, speeds: Sequence[float], acceleration: float) -> Ticks:
    """Move the tool at *speeds* until it touches something, then stop."""
    moving = jog(robot, speeds, (0.0,) * 6, acceleration)
    while not robot.is_touching:
        next(moving)
        yield
    yield from stop(robot, 3.0)


def _turned(speeds: Sequence[float], frame: Sequence[float]) -> list[float]:
    """Return speeds given in *frame* in base coordinates."""
    rows = from_pose((0.0, 0.0, 0.0, *frame[3:]))
    return [
        sum(rows[4 * row + column] * speeds[first + column] for column in range(3))
        for first in (0, 3)
        for row in range(3)
    ]


def push(robot: Controller, speeds: Sequence[float]) -> None:
    """Move the tool at *speeds* for one tick."""
    ahead = robot.tool.pose_ahead(speeds, TICK * robot.speed_scaling)
    robot.arm.follow(robot.tool.joints_at(ahead))


def _follow(robot: Controller, length: float, at: Path, speed: float, acceleration: float) -> Ticks:
    """Follow *at* over ``0..length`` with a trapezoid of speed."""
    along = rate = 0.0
    speed, acceleration = max(speed, 1e-3), max(acceleration, 1e-3)
    while along < length:
        dt = TICK * robot.speed_scaling
        brakes = math.sqrt(2.0 * acceleration * max(length - along, 0.0))
        rate = min(speed, rate + acceleration * dt, max(brakes, acceleration * dt))
        along = min(length, along + rate * dt)
        robot.arm.follow(at(along))
        yield
    robot.arm.hold()
