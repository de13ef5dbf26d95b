"""Motions of several devices of several daemons that start in one instant, or not at all.

First everything is prepared: the leases are taken, all or none and always in the same order, and
every motion is planned.  Then one instant of our clock is translated to the clock of each daemon,
and each motion is asked for with that; the gateways hand them on once every one was asked
(:mod:`orientd.fleet.start_barrier`), and each daemon has its motion fed and armed before it begins.
How far apart they began is measured from the servos' cycles.
"""

from __future__ import annotations

import json
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from orientd.errors import DaemonError, OrientdError, StateError
from orientd.fleet.channel import START_KEY
from orientd.fleet.clocks import Offset
from orientd.fleet.plan_file import START_IN, FleetMotion
from orientd.fleet.start_barrier import NOT_READY
from orientd.rpc import MoveHandle, Robot, StartAt

if TYPE_CHECKING:
    from orientd.fleet.client import Fleet
    from orientd.rpc import Plan, Summary

LEAST_MARGIN_NS = 50_000_000
"""Time before the start in which nobody is let begin any more: the others are to hear of it."""

_TRIPS = 6
"""Round trips of the slowest daemon that a start takes before its margin."""

ATTEMPTS = 3
"""Times that a start is given which some of the daemons hear of too late to take part."""

_DROPPING = 0.3
"""What the daemons may take to drop what was armed for a start that does not come, s."""

_ARMING_NS = 150_000_000
"""What the daemons may take to feed a motion and arm it."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How one motion went.

    Attributes:
        motion: what was asked for.
        plan: of it.
        summary: how it ended; ``None`` where its daemon was lost.
        problem: what was wrong with its daemon; empty if nothing.
    """

    motion: FleetMotion
    plan: Plan
    summary: Summary | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Together:
    """How motions went that were started together.

    Attributes:
        ended: each of them.
        skew: between the first one's beginning and the last one's, s; ``None`` of one alone, or
            where a beginning is not known.
        skew_bound: how far *skew* may be wrong because of what is known of the clocks, s.
    """

    ended: Sequence[Ended]
    skew: float | None
    skew_bound: float | None

    @property
    def problem(self) -> str:
        """What did not go as it was asked for; empty if nothing."""
        bad = [
            f"{one.motion}: {one.problem or (one.summary and one.summary.text) or 'stopped'}"
            for one in self.ended
            if one.summary is None or not one.summary.outcome.is_as_asked
        ]
        return "; ".join(bad)


Tell = Callable[[str], object]


def move_together(
    fleet: Fleet,
    motions: Sequence[FleetMotion],
    *,
    start_in: float = START_IN,
    holder: str = "fleet move",
    tell: Tell = lambda _: None,
) -> Together:
    """Move several devices, all from the same instant; return once all have ended.

    Where one ends otherwise than it was asked to, or its daemon is lost, the others are stopped on
    their paths.  Where whoever asks is lost, every daemon stops its own.

    Args:
        fleet: of their daemons.
        motions: one for each device.
        start_in: from when everything is planned to the start, s; more where the network is slow,
            and where a start has to be given again because some heard of it too late.
        holder: what others are told who are refused because of this.
        tell: told what is being done.

    Raises:
        LeaseError: somebody else commands one of them.
        PlanError: one of them cannot be planned.
        OrientdError: one of them cannot begin.  In all of these cases none has moved.
    """
    ordered = sorted(motions, key=lambda motion: (motion.daemon, motion.device))
    with ExitStack() as kept, ThreadPoolExecutor(len(ordered)) as pool:
        robots = _take_leases(fleet, ordered, holder, kept)
        tell("planning")
        plans = list(pool.map(lambda one: _plan(robots[one.daemon], one), ordered))
        for attempt in range(1, ATTEMPTS + 1):
            tell("measuring clocks")
            measured = pool.map(lambda name: _offset(fleet, name), robots)
            offsets = dict(zip(robots, measured, strict=True))
            starts, start_ns = _starts(fleet, ordered, offsets, start_in)
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
            except StateError as error:
                if attempt == ATTEMPTS or NOT_READY not in str(error):
                    raise
                tell(f"{error}; once more")
                time.sleep(_DROPPING)
                start_in *= 2.0
        # Once more, close to the start: how far apart they began is judged by this.
        list(pool.map(lambda name: fleet.clock(name).measure(), robots))
        tell("moving")
        ended = _wait(ordered, handles, pool)
        skew, bound = _skew(fleet, ended, starts, start_ns)
        return Together(ended, skew, bound)


def _take_leases(
    fleet: Fleet, ordered: Sequence[FleetMotion], holder: str, kept: ExitStack
) -> dict[str, Robot]:
    """Return a robot of each daemon that has the lease of its devices, in the order of names."""
    robots: dict[str, Robot] = {}
    for daemon in sorted({one.daemon for one in ordered}):
        robots[daemon] = kept.enter_context(fleet.robot(daemon, holder=holder))
        devices = [one.device for one in ordered if one.daemon == daemon]
        with _of(daemon):
            robots[daemon].acquire_lease(*devices)
    return robots


def _plan(robot: Robot, one: FleetMotion) -> Plan:
    with _of(str(one)):
        return robot.plan(one.request, device=one.device)


def _offset(fleet: Fleet, daemon: str) -> Offset:
    offset = fleet.clock(daemon).measure()
    if offset is None:
        raise DaemonError(f"{daemon} does not tell its time")
    return offset


def _starts(
    fleet: Fleet, ordered: Sequence[FleetMotion], offsets: dict[str, Offset], start_in: float
) -> tuple[dict[str, StartAt], int]:
    """Return when each daemon is to begin, on its clock; and when that is on ours."""
    trip_ns = max(fleet.clock(name).round_trip_ns for name in offsets)
    margin_ns = max(LEAST_MARGIN_NS, _TRIPS * trip_ns)
    ahead_ns = max(round(start_in * 1e9), 2 * margin_ns + _ARMING_NS)
    start_ns = time.monotonic_ns() + ahead_ns
    parts = Counter(one.daemon for one in ordered)
    name = secrets.token_hex(8)
    starts = {}
    for daemon, offset in offsets.items():
        there = start_ns + offset.ns
        said = {
            "id": name,
            "among": sorted(offsets),
            "parts": parts[daemon],
            "start_ns": there,
            "until_ns": there - margin_ns,
        }
        starts[daemon] = StartAt(there, ((START_KEY, json.dumps(said)),))
    return starts, start_ns


def _all_or_none(
    ordered: Sequence[FleetMotion], begun: Sequence[Future[MoveHandle]]
) -> list[MoveHandle]:
    """Return the motions, all of which are armed; or end them all before they begin.

    Raises:
        OrientdError: one could not be armed.
    """
    errors: list[tuple[FleetMotion, OrientdError]] = []
    handles = []
    for one, future in zip(ordered, begun, strict=True):
        try:
            handles.append(future.result())
        except OrientdError as error:
            errors.append((one, error))
    if not errors:
        return handles
    for handle in handles:
        handle.abandon()
    # Those that were dropped for the sake of another know less than that one.
    one, cause = min(errors, key=lambda pair: "cannot begin" in str(pair[1]))
    cause.args = (f"{one}: {cause}; nothing moves", *cause.args[1:])
    raise cause


def _wait(
    ordered: Sequence[FleetMotion], handles: Sequence[MoveHandle], pool: ThreadPoolExecutor
) -> list[Ended]:
    """Wait until all have ended; as soon as one does so otherwise than asked, stop the others."""
    futures = {pool.submit(handle.wait): number for number, handle in enumerate(handles)}
    ended: dict[int, Ended] = {}
    is_stopped = False
    for future in as_completed(futures):
        number = futures[future]
        motion, plan = ordered[number], handles[number].plan
        try:
            summary = future.result()
            ended[number] = Ended(motion, plan, summary)
            is_good = summary.outcome.is_as_asked
        except OrientdError as error:
            ended[number], is_good = Ended(motion, plan, None, str(error)), False
        if not is_good and not is_stopped:
            is_stopped = True
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
        lateness = None if one.summary is None else one.summary.start_lateness
        offset = fleet.clock(daemon).at(start_ns)
        if lateness is None or offset is None:
            return None, None
        bounds[daemon] = offset.bound_ns
        instants.append(starts[daemon].monotonic_ns - start_ns - offset.ns + lateness * 1e9)
    if len(instants) < 2:
        return None, None
    # Each may be wrong by its own bound, and the two that count by both of theirs.
    widest = sum(sorted(bounds.values())[-2:]) if len(bounds) > 1 else 0
    return (max(instants) - min(instants)) * 1e-9, widest * 1e-9


@contextmanager
def _of(what: str) -> Iterator[None]:
    """Say of what an error is."""
    try:
        yield
    except OrientdError as error:
        error.args = (f"{what}: {error}", *error.args[1:])
        raise
