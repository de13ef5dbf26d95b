"""The few statements of URScript that are understood: motions, registers, waiting.

Programs that clients send are no more than such statements in a row.  Anything else ends the
program with an error, so that nothing is taken for done that was not.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from orientd_sim.ur.arm import TICK
from orientd_sim.ur.programs.motions import Ticks, move_joints, move_line

if TYPE_CHECKING:
    from orientd_sim.ur.controller import Controller

_CALL = re.compile(r"^\s*(\w+)\((.*)\)\s*$")
_VECTOR = re.compile(r"(p?)\[([^\]]*)\]")
_NAMED = re.compile(r"\b([avrt])\s*=\s*([-+0-9.eE]+)")
_NOTHING_TO_DO = frozenset({"textmsg", "sync", "popup", "set_tool_voltage"})
_LARGEST = 1e6
_SKIPPED = re.compile(r"^\s*(#.*|def .*:|sec .*:|end|)\s*$")


class UnknownStatementError(Exception):
    """A line that is not emulated."""


@dataclass(frozen=True, slots=True)
class Statement:
    """One call.

    Attributes:
        name: of the function.
        vectors: its lists and poses, each with whether it is a pose.
        numbers: its other arguments by position.
        named: its arguments ``a``, ``v``, ``r`` and ``t``.
    """

    name: str
    vectors: tuple[tuple[bool, tuple[float, ...]], ...] = ()
    numbers: tuple[float, ...] = ()
    named: dict[str, float] = field(default_factory=dict)


def finite(values: Iterable[float]) -> tuple[float, ...]:
    """Return *values* as they are.

    Raises:
        UnknownStatementError: one is not a number, or larger than any quantity of a robot.
    """
    numbers = tuple(values)
    if not all(abs(number) < _LARGEST for number in numbers):
        raise UnknownStatementError(f"no numbers for a robot: {numbers}")
    return numbers


def parse(text: str) -> list[Statement]:
    """Return the statements of a program's body.

    Raises:
        UnknownStatementError: a line is none of those that are understood.
    """
    return [_statement(line) for line in text.splitlines() if not _SKIPPED.match(line)]


def perform(
    robot: Controller, statements: Sequence[Statement], on_progress: Callable[[int], None]
) -> Ticks:
    """Carry out *statements*, one after the other.

    Args:
        robot: whose arm and registers they are for.
        statements: what to do.
        on_progress: is told what a program says of its own progress.
    """
    for one in statements:
        if one.name in _NOTHING_TO_DO:
            continue
        if one.name == "signal_async_progress":
            on_progress(round(one.numbers[0]))
        elif one.name == "write_output_integer_register":
            robot.output_ints[round(one.numbers[0])] = round(one.numbers[1])
        elif one.name == "sleep":
            for _ in range(round(one.numbers[0] / TICK)):
                yield
        else:
            yield from _move(robot, one)


def _move(robot: Controller, one: Statement) -> Ticks:
    """Move to each place that is named; corners are not blended."""
    speed, rate = one.named.get("v", 0.25), one.named.get("a", 1.2)
    for is_pose, goal in one.vectors:
        if one.name != "movej":
            yield from move_line(robot, goal, speed, rate, is_joints=not is_pose)
        else:
            joints = robot.tool.joints_at(goal) if is_pose else goal
            yield from move_joints(robot, joints, speed, rate)


def _statement(line: str) -> Statement:
    call = _CALL.match(line)
    if call is None:
        raise UnknownStatementError(f"not emulated: {line.strip()}")
    name, arguments = call.groups()
    if name in _NOTHING_TO_DO:
        return Statement(name)
    try:
        vectors = tuple(
            (bool(kind), finite(float(x) for x in inside.split(",")))
            for kind, inside in _VECTOR.findall(arguments)
        )
        named = {key: finite([float(value)])[0] for key, value in _NAMED.findall(arguments)}
        rest = _NAMED.sub("", _VECTOR.sub("", arguments))
        # Registers are named as a sum, `0 +24`.
        numbers = finite(
            sum(float(term) for term in part.replace("+", " ").split())
            for part in rest.split(",")
            if part.strip()
        )
    except ValueError as error:
        raise UnknownStatementError(f"not emulated: {line.strip()}") from error
    counts = {"signal_async_progress": 1, "write_output_integer_register": 2, "sleep": 1}
    is_motion = name in ("movej", "movel", "movep") and len(vectors) == 1
    if not is_motion and counts.get(name) != len(numbers):
        raise UnknownStatementError(f"not emulated: {line.strip()}")
    if any(len(goal) != 6 for _, goal in vectors):
        raise UnknownStatementError(f"not emulated: {line.strip()}")
    return Statement(name, vectors, numbers, named)
