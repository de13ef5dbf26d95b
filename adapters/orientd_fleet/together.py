"""Start motions of several devices of several daemons in one instant, or none of them.

First everything is prepared: all leases are taken, always in the same order, and every motion is
planned.  Then one instant of our clock is translated to the clock of each daemon, and each daemon
arms its motion for that instant.  If one has not done so in time, all motions are withdrawn before
they begin.  A daemon withdraws its motion by itself when this client's connection ends.  The
servos' cycles tell how far apart the motions began.

A file has a motion for each of several devices of several daemons:

.. code-block:: yaml

    start_in: 1.0                  # s from the end of planning to the start; default 0.5
    motions:
      - daemon: arm-1
        device: arm                # if the daemon has several
        motion: {keyframes: [{rotation_vector: [0, 0, 0.5]}]}
      - daemon: arm-2
        file: turn.yaml            # in the folder of this file
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NotRequired

from pydantic import Field

from orientd import motion_file
from orientd.client.connection import StartAt
from orientd.client.daemon_clock import Offset
from orientd.client.move_handle import MoveHandle
from orientd.client.robot import Robot
from orientd.config.table import Name
from orientd.errors import DaemonError, LateError, OrientdError, RequestError, naming
from orientd.model.fields import Number, StrictTable, Text
from orientd.model.reading import read_as
from orientd.model.request import MotionRequest
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import GOOD_OUTCOMES
from orientd.structured_text import read_structured

if TYPE_CHECKING:
    from orientd_fleet.client import Fleet

START_IN = 0.5
"""Time from the end of planning to the start unless a plan says otherwise, s."""

LEAST_MARGIN_NS = 50_000_000
"""Time before the start in which motions are only withdrawn, not armed any more."""

_TRIPS = 6
"""Round trips of the slowest daemon that the margin lasts at least."""

ATTEMPTS = 3
"""How often a start is attempted if some daemons arm their motions too late."""

_WITHDRAWING = 0.3
"""Time for the daemons to withdraw armed motions before the next attempt, s."""

_ARMING_NS = 150_000_000
"""Time for the daemons to feed a motion and arm it."""


@dataclass(frozen=True, slots=True)
class FleetMotion:
    """The motion of one device.

    Attributes:
        daemon: its name in the cell.
        device: of that daemon; empty for the only one.
        request: the motion.
    """

    daemon: str
    device: str
    request: MotionRequest

    def __str__(self) -> str:
        return f"{self.daemon}/{self.device}" if self.device else self.daemon


@dataclass(frozen=True, slots=True)
class Ended:
    """How one motion went.

    Attributes:
        motion: as requested.
        plan: of it.
        summary: how it ended; ``None`` if its daemon was lost.
        problem: of its daemon, or the motion because of which it was stopped; empty if none.
    """

    motion: FleetMotion
    plan: pb.Plan
    summary: pb.MoveSummary | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Together:
    """How motions went that started together.

    Attributes:
        ended: each of them.
        skew: between the first beginning and the last, s; ``None`` for a single motion, or if a
            beginning is not known.
        skew_bound: how far *skew* may be wrong because of the clocks, s.
    """

    ended: Sequence[Ended]
    skew: float | None
    skew_bound: float | None

    @property
    def problem(self) -> str:
        """Which motions did not end as requested; empty if all did."""
        bad = [
            f"{one.motion}: {one.problem or (one.summary and one.summary.text) or 'stopped'}"
            for one in self.ended
            if one.summary is None or one.summary.outcome not in GOOD_OUTCOMES
        ]
        return "; ".join(bad)


def move_together(
    fleet: Fleet,
    motions: Sequence[FleetMotion],
    *,
    start_in: float = START_IN,
    holder: str = "fleet move",
    tell: Callable[[str], object] = lambda _: None,
) -> Together:
    """Move several devices, all from the same instant; return once all have ended.

    If one ends otherwise than requested, or its daemon is lost, the others stop on their paths.
    If this client is lost, every daemon stops its own.

    Args:
        fleet: of their daemons.
        motions: one for each device.
        start_in: from the end of planning to the start, s; longer over a slow network, and after
            an attempt that came too late.
        holder: named to others who are refused meanwhile.
        tell: called with each step.

    Raises:
        LeaseError: another client holds the lease of one of the devices.
        PlanError: one motion cannot be planned.
        OrientdError: one motion cannot begin.  In all of these cases no device has moved.
    """
    ordered = sorted(motions, key=lambda motion: (motion.daemon, motion.device))
    # Robots close first, also on Ctrl-C: that ends the motions which the pool waits for.
    with ThreadPoolExecutor(3 * len(ordered)) as pool, ExitStack() as kept:
        robots = _take_leases(fleet, ordered, holder, kept)
        tell("planning")
        plans = list(pool.map(lambda one: _plan(robots[one.daemon], one), ordered))
        for attempt in range(1, ATTEMPTS + 1):
            tell("measuring clocks")
            offsets = dict(zip(robots, pool.map(fleet.offset, robots), strict=True))
            starts, start_ns = _starts(fleet, offsets, start_in)
            tell(f"starting in {(start_ns - time.monotonic_ns()) * 1e-9:.2f} s")
            begun = [
                pool.submit(
                    robots[one.daemon].move, plan, device=one.device, start_time=starts[one.daemon]
                )
                for one, plan in zip(ordered, plans, strict=True)
            ]
            try:
                handles = _all_or_none(ordered, begun)
                break
            except LateError as error:
                if attempt == ATTEMPTS:
                    raise
                tell(f"{error}; once more")
                time.sleep(_WITHDRAWING)
                start_in *= 2.0
        # Measured close to the start: the skew is judged by these offsets.
        for name in robots:
            pool.submit(fleet.clock(name).measure)
        tell("moving")
        ended = _wait(ordered, handles, pool)
        skew, bound = _skew(fleet, ended, starts, start_ns)
        return Together(ended, skew, bound)


def _take_leases(
    fleet: Fleet, ordered: Sequence[FleetMotion], holder: str, kept: ExitStack
) -> dict[str, Robot]:
    """Return a robot of each daemon, by name in their order, that has the lease of its devices."""
    robots: dict[str, Robot] = {}
    for daemon in dict.fromkeys(one.daemon for one in ordered):
        robots[daemon] = kept.enter_context(fleet.robot(daemon, holder=holder))
        devices = [one.device for one in ordered if one.daemon == daemon]
        with naming(daemon):
            robots[daemon].acquire_lease(*devices)
    return robots


def _plan(robot: Robot, one: FleetMotion) -> pb.Plan:
    with naming(str(one)):
        return robot.plan(one.request, device=one.device)


def _starts(
    fleet: Fleet, offsets: dict[str, Offset], start_in: float
) -> tuple[dict[str, StartAt], int]:
    """Return the start on the clock of each daemon, and on ours."""
    trip_ns = max(fleet.clock(name).round_trip_ns for name in offsets)
    margin_ns = max(LEAST_MARGIN_NS, _TRIPS * trip_ns)
    ahead_ns = max(round(start_in * 1e9), 2 * margin_ns + _ARMING_NS)
    start_ns = time.monotonic_ns() + ahead_ns
    armed_by = (start_ns - margin_ns) * 1e-9
    starts = {name: StartAt(start_ns + offset.ns, armed_by) for name, offset in offsets.items()}
    return starts, start_ns


def _all_or_none(
    ordered: Sequence[FleetMotion], begun: Sequence[Future[MoveHandle]]
) -> list[MoveHandle]:
    """Return the motions once all are armed, or withdraw all before they begin.

    Raises:
        OrientdError: one could not be armed; the message says if another one may still move.
    """
    errors: list[tuple[FleetMotion, OrientdError]] = []
    armed: list[tuple[FleetMotion, MoveHandle]] = []
    for one, future in zip(ordered, begun, strict=True):
        try:
            armed.append((one, future.result()))
        except OrientdError as error:
            errors.append((one, error))
    if not errors:
        return [handle for _, handle in armed]
    with ThreadPoolExecutor(len(ordered)) as pool:
        problems = "; ".join(filter(None, pool.map(_withdraw, armed)))
    # Another attempt would not help against any other error.
    one, cause = min(errors, key=lambda pair: isinstance(pair[1], LateError))
    if problems:
        raise DaemonError(f"{one}: {cause}; {problems}") from cause
    cause.args = (f"{one}: {cause}; nothing moves", *cause.args[1:])
    raise cause


def _withdraw(armed: tuple[FleetMotion, MoveHandle]) -> str:
    """Withdraw a motion before it begins; return why it may still begin, or an empty string."""
    motion, handle = armed
    try:
        handle.cancel()
    except OrientdError as error:
        return f"{motion} may still move: {error}"
    finally:
        handle.abandon()
    return ""


def _wait(
    ordered: Sequence[FleetMotion], handles: Sequence[MoveHandle], pool: ThreadPoolExecutor
) -> list[Ended]:
    """Wait until all motions have ended; once one ends otherwise than asked, stop the others."""
    futures = {
        pool.submit(handle.wait, check=False): number for number, handle in enumerate(handles)
    }
    ended: dict[int, Ended] = {}
    first_bad: FleetMotion | None = None
    for future in as_completed(futures):
        number = futures[future]
        motion, plan = ordered[number], handles[number].plan
        try:
            summary = future.result()
            is_good = summary.outcome in GOOD_OUTCOMES
            is_stopped = summary.outcome == pb.OUTCOME_STOPPED and first_bad is not None
            problem = f"stopped because of {first_bad}" if is_stopped else ""
            ended[number] = Ended(motion, plan, summary, problem)
        except OrientdError as error:
            ended[number], is_good = Ended(motion, plan, None, str(error)), False
        if not is_good and first_bad is None:
            first_bad = motion
            for handle in handles:
                pool.submit(handle.cancel)
    return [ended[number] for number in range(len(handles))]


def _skew(
    fleet: Fleet, ended: Sequence[Ended], starts: dict[str, StartAt], start_ns: int
) -> tuple[float | None, float | None]:
    """Return how far apart the motions began, and how far that may be wrong, s."""
    instants, bounds = [], {}
    for one in ended:
        daemon = one.motion.daemon
        offset = fleet.clock(daemon).at(start_ns)
        if one.summary is None or not one.summary.HasField("start_lateness") or offset is None:
            return None, None
        lateness = one.summary.start_lateness
        bounds[daemon] = offset.bound_ns
        instants.append(starts[daemon].monotonic_ns - start_ns - offset.ns + lateness * 1e9)
    if len(instants) < 2:
        return None, None
    # Each may be wrong by its own bound, and the two that count by both of theirs.
    widest = sum(sorted(bounds.values())[-2:]) if len(bounds) > 1 else 0
    return (max(instants) - min(instants)) * 1e-9, widest * 1e-9


class _Entry(StrictTable):
    """A motion of a plan; it is here, or in a file."""

    daemon: Name
    device: NotRequired[Text]
    motion: NotRequired[MotionRequest]
    file: NotRequired[Text]


class _Plan(StrictTable):
    """The content of a plan."""

    motions: Annotated[list[_Entry], Field(min_length=1)]
    start_in: NotRequired[Annotated[Number, Field(gt=0.0)]]


def read_plan(path: Path) -> tuple[list[FleetMotion], float]:
    """Return the motions in a file, and the time from the end of planning to their start, s.

    Raises:
        RequestError: the file cannot be read or is not well formed.
    """
    plan: _Plan = read_as(_Plan, read_structured(path))
    motions = []
    for number, one in enumerate(plan["motions"]):
        if ("file" in one) == ("motion" in one):
            problem = "expected either a motion here or a file"
            raise RequestError(f"motions[{number}].motion", problem)
        request = one["motion"] if "motion" in one else motion_file.load(path.parent / one["file"])
        motions.append(FleetMotion(one["daemon"], one.get("device", ""), request))
    names = [str(motion) for motion in motions]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RequestError("motions", f"expected each device once, got {twice} twice")
    return motions, plan.get("start_in", START_IN)
