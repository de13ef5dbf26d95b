"""`orientd bench`: lateness, plans, retargets, starts and stops, measured on this machine."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.output import Output, table, working
from orientd.cli.own_daemon import recorded, simulated
from orientd.cli.parameters import ANYTHING, Option, command_of
from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.client.move_handle import MoveHandle
    from orientd.client.robot import Robot
    from orientd.protocol import control_pb2 as pb
    from orientd.stream.records import Cycle

DEVICE = 'driver = "loopback"\n'
KEYFRAMES = 20
LONGEST = 5.0  # s, until a command shows in a cycle


@dataclass(frozen=True)
class Times:
    """How many durations were measured, their median and the worst of them, s."""

    count: int
    median: float
    worst: float


def measure(
    out: Output,
    seconds: Annotated[
        float, Option(range=(0.5, 3600.0), help="Duration of the motion that shows lateness, s.")
    ] = 2.0,
    count: Annotated[
        int, Option(range=(1, 10_000), help="Number of plans (20 keyframes), retargets and stops.")
    ] = 20,
) -> None:
    """Measure lateness, plans, retargets, starts and stops here.

    The command starts daemons of its own with a simulated device at 500 Hz.  A retarget and a stop
    take until the first setpoint that shows them, and a start until the device is ready.
    """
    context = click.get_current_context()
    if context.args:  # version 0.2 had more options, and `bench retarget`
        raise click.UsageError(
            f"unexpected {context.args[0]!r}: comparisons with a C loop and with SciPy, and the "
            "parts of a retarget, are in `make bench` of the sources",
            context,
        )
    from orientd.client.robot import connect

    chance = random.Random(1)
    with working("measuring"):
        starts = [_start() for _ in range(min(count, 5))]  # each takes longer than all else
        with simulated(DEVICE) as socket, connect(socket, holder="orientd bench") as robot:
            (device,) = robot.state().devices.values()
            _plan(robot, chance)  # the first plan loads the planner
            plans = [_plan(robot, chance) for _ in range(count)]
            late = _ended(robot.turn([0.0, 0.0, 0.5], seconds)).statistics
            with recorded(robot) as cycles:
                robot.move(_keyframes(1, chance), approach=True)
                retargets = [_retarget(robot, cycles, chance) for _ in range(count)]
                stops = [_stop(robot, cycles, chance) for _ in range(count)]
    taken = {"plan": plans, "retarget": retargets, "start": starts, "stop": stops}
    found = {"lateness": Times(late.cycles, late.lateness.p50, late.lateness.largest)}
    found |= {name: Times(len(one), median(one), max(one)) for name, one in taken.items()}
    rows = [
        [name, str(one.count), f"{1e3 * one.median:.3f}", f"{1e3 * one.worst:.3f}"]
        for name, one in found.items()
    ]
    lines = table(["", "count", "median, ms", "worst, ms"], rows)
    out.answer({"scheduling": device.scheduling, **found}, f"servo: {device.scheduling}", *lines)


bench = command_of(click.Command, measure, name="bench", context_settings=ANYTHING)


def _start() -> float:
    begin = time.monotonic()
    with simulated(DEVICE):
        return time.monotonic() - begin


def _plan(robot: Robot, chance: random.Random) -> float:
    keyframes, begin = _keyframes(KEYFRAMES, chance), time.monotonic()
    robot.plan(keyframes, approach=True)
    return time.monotonic() - begin


def _retarget(robot: Robot, cycles: list[Cycle], chance: random.Random) -> float:
    """Return the time from a retarget of the moving device to the first setpoint of it, s."""
    time.sleep(chance.uniform(0.08, 0.16))
    cycles.clear()
    sent_ns = time.monotonic_ns()
    handle = robot.move(_keyframes(1, chance), approach=True)
    return (_first(cycles, lambda one: one.motion == handle.motion_number, handle) - sent_ns) * 1e-9


def _stop(robot: Robot, cycles: list[Cycle], chance: random.Random) -> float:
    """Return the time from a stop of the moving device to its first setpoint that brakes, s."""
    handle = robot.move(_keyframes(KEYFRAMES, chance), approach=True)
    time.sleep(chance.uniform(0.08, 0.16))
    cycles.clear()
    sent_ns = time.monotonic_ns()
    robot.stop()
    braked_ns = _first(cycles, lambda one: one.state.name == "STOPPING", handle)
    _ended(handle)
    return (braked_ns - sent_ns) * 1e-9


def _keyframes(count: int, chance: random.Random) -> list[dict[str, list[float]]]:
    """Return *count* keyframes, each near to the one before, the first of them anywhere."""
    vector, found = [chance.uniform(-1.0, 1.0) for _ in range(3)], []
    for _ in range(count):
        found.append({"rotation_vector": vector})
        vector = [part + chance.uniform(-0.15, 0.15) for part in vector]
    return found


def _first(cycles: Sequence[Cycle], is_it: Callable[[Cycle], bool], handle: MoveHandle) -> int:
    """Wait for the first cycle for which *is_it* is true, and return its deadline in ns."""
    end = time.monotonic() + LONGEST
    while time.monotonic() < end:
        for cycle in tuple(cycles):
            if is_it(cycle):
                return cycle.deadline_ns
        if handle.is_done:
            _ended(handle)
        time.sleep(0.01)
    raise OrientdError(f"no cycle of motion {handle.motion_number} came within {LONGEST:g} s")


def _ended(handle: MoveHandle) -> pb.MoveSummary:
    """Return the summary of a motion once it has ended; a fault is an error."""
    from orientd.protocol import control_pb2 as pb

    summary = handle.wait(check=False)
    if summary.outcome == pb.OUTCOME_FAULT:
        raise OrientdError(f"the device faulted: {summary.text}")
    return summary
