"""Watches one daemon for all pages: state, cycles and the plan that runs.

Cycles are streamed while a page is open.  New values replace old ones, so a slow page delays
nothing.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from orientd.client.observer import Observer
from orientd.client.robot import Robot
from orientd.errors import DaemonError, OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import STALE, CellReport, Outline
from orientd.protocol.values import to_quaternion, to_vector
from orientd.stream.records import Cycle
from orientd.viewer.charts import Strips

BATCHES_HZ = 30.0
POLL = 0.2
"""From one look at the state to the next, s."""

MOST_SAMPLES = 1500
FASTEST_SAMPLES_HZ = 100.0
SLOWEST_SAMPLES_HZ = 0.01


@dataclass(frozen=True, slots=True)
class Sight:
    """The device on the page, as the daemon last reported it.

    Attributes:
        problem: why there is no newer report; empty while all is well.
        cell: the daemon and its devices; ``None`` before they were first seen.
        device: name of the device.
        pose: of its newest cycle, as the page draws it.
        outline: its shape.
        plan: of its newest motion, with samples.
        seen: when the daemon last answered, s on :func:`time.monotonic`.
        alive: when the servo's newest cycle was; *seen* if there is no servo.
    """

    problem: str = ""
    cell: CellReport | None = None
    device: str = ""
    pose: dict[str, Any] | None = None
    outline: Outline = ()
    plan: pb.Plan | None = None
    seen: float = 0.0
    alive: float = 0.0

    @property
    def report(self) -> pb.DeviceReport | None:
        """The device as the daemon reports it."""
        return None if self.cell is None else self.cell.devices.get(self.device)

    def age(self, now: float) -> float:
        """Return how old this is at *now*, s on :func:`time.monotonic`."""
        return max(0.0, now - min(self.seen, self.alive))

    def trouble(self, now: float) -> str:
        """Return why this is out of date at *now*; empty while it is not."""
        if self.problem:
            return self.problem
        if now - self.seen > STALE:
            return f"no word from the daemon for {now - self.seen:.0f} s"
        if now - self.alive > STALE:
            return f"no cycle of its servo for {now - self.alive:.0f} s"
        return ""


def sample_rate(duration: float, device_hz: float) -> float:
    """Return how often to sample a motion so that its path looks smooth.

    >>> sample_rate(2.0, 500.0), sample_rate(150.0, 500.0)
    (100.0, 10.0)
    """
    wanted = min(FASTEST_SAMPLES_HZ, MOST_SAMPLES / max(duration, 1e-3))
    return min(max(wanted, SLOWEST_SAMPLES_HZ), device_hz)


class Watcher:
    """Watch a daemon from its own thread, which alone changes :attr:`sight`.

    Attributes:
        sight: the newest state.
        strips: the last seconds of the device.
        is_watched: whether a page is open; cycles are streamed only then.
        chosen: the device to show; the daemon's first one while this names none of its devices.
    """

    def __init__(self, connect: Callable[[], Robot]) -> None:
        """Connect with *connect* now, and look from now on.

        Raises:
            OrientdError: no daemon answers.
        """
        self._connect = connect
        self.sight, self.strips = Sight(), Strips()
        self.is_watched, self.chosen = False, ""
        self._closing = threading.Event()
        self._observer: Observer | None = None
        self._robot: Robot | None = None
        self._last_robot = self._robot = connect()
        self._look(self._robot)
        self._thread = threading.Thread(target=self._work, name="watcher", daemon=True)
        self._thread.start()

    @property
    def connection(self) -> Robot | None:
        """The connection, if there is one."""
        return self._robot

    def robot(self, *, even_lost: bool = False) -> Robot:
        """Return the connection, for commands; with *even_lost* the last one, to stop by.

        Raises:
            DaemonError: the daemon does not answer at present.
        """
        robot = self._last_robot if even_lost else self._robot
        if robot is None:
            raise DaemonError(self.sight.problem or "no daemon answers")
        return robot

    def close(self) -> None:
        """Stop watching and close the connection, which releases the lease if it is held."""
        self._closing.set()
        if self._observer is not None:
            self._observer.close()
        self._thread.join()
        self._part()

    def _work(self) -> None:
        while not self._closing.wait(POLL):
            try:
                if self._robot is None:
                    self._robot = self._last_robot = self._connect()
                self._look(self._robot)
                if self.is_watched:
                    self._stream(self._robot)
            except OrientdError as error:
                self._part()
                self.sight = replace(self.sight, problem=str(error))

    def _part(self) -> None:
        robot, self._robot = self._robot, None
        if robot is not None:
            robot.close()

    def _look(self, robot: Robot) -> None:
        """Store the state, and fetch the plan of a new motion."""
        asked = time.monotonic()
        cell = robot.state()
        device = self.chosen if self.chosen in cell.devices else next(iter(cell.devices))
        before = self.sight if self.sight.device == device else Sight(device=device)
        report, plan = cell.devices[device], before.plan
        if not report.motion_id:
            plan = None
        elif plan is None or plan.motion_id != report.motion_id:
            rate_hz = sample_rate(report.duration, report.rate_hz)
            plan = robot.planned(device=device, sample_rate_hz=rate_hz)
        self.sight = replace(
            before,
            problem="",
            cell=cell,
            pose=_reported(report),
            plan=plan,
            seen=asked,
            alive=max(asked - report.cycle_age * bool(report.servo_pid), before.alive),
        )

    def _stream(self, robot: Robot) -> None:
        """Store cycles while a page is open and shows this device."""
        report, looked, chosen = self.sight.report, self.sight.seen, self.chosen
        if report is None:
            return
        self.strips = strips = Strips(round(report.lead * report.rate_hz))
        with contextlib.closing(robot.observe()) as self._observer:
            if self._closing.is_set():
                return  # close() ran before the observer was there
            for cycles, outline in self._observer.sight(report.name, rate_hz=BATCHES_HZ):
                now = time.monotonic()
                if not self.is_watched or self.chosen != chosen:
                    return
                if now - looked > POLL:
                    self._look(robot)
                    looked = now
                strips.add(cycles)
                self.sight = replace(self.sight, outline=outline, seen=now)
                if cycles:
                    self.sight = replace(self.sight, pose=_recorded(cycles[-1]), alive=now)


def _recorded(cycle: Cycle) -> dict[str, Any]:
    """Return the pose of a cycle that was streamed."""
    return {
        "sent": cycle.q,
        "position": cycle.position,
        "measured": cycle.feedback_q if cycle.has_feedback else None,
        "measuredPosition": cycle.feedback_position,
    }


def _reported(report: pb.DeviceReport) -> dict[str, Any] | None:
    """Return the pose of the newest cycle in *report*, if it has one."""
    if not report.HasField("cycle"):
        return None
    cycle = report.cycle
    return {
        "sent": to_quaternion(cycle.q),
        "position": to_vector(cycle.position),
        "measured": to_quaternion(cycle.feedback_q) if cycle.HasField("feedback_q") else None,
        "measuredPosition": to_vector(cycle.feedback_position),
    }
