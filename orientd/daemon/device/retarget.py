"""Turn a request into a running motion: choose its start record, and plan again if it is late.

A new motion on a moving device leaves the running one at a record a little ahead of the servo.  How
far ahead is the replanning horizon.  By the time it is planned, the servo may have passed that
record, or the axes cannot continue from it.  The planner then starts from a later record.  Only
this module tries a plan again.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence

from orientd.daemon.device.queue import MotionQueue
from orientd.daemon.device.queued_motion import QueuedMotion, SplicePoint
from orientd.daemon.device.servo_process import ServoProcess
from orientd.daemon.planners.messages import PlanRequest, Rank, record_at_rest
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.pool import Planners
from orientd.daemon.workers import DeviceWorkers
from orientd.driver import Joints
from orientd.errors import (
    DeadlineError,
    LateError,
    LimitError,
    NotYetError,
    PlanError,
    StartError,
    StateError,
)
from orientd.floats import difference, norm
from orientd.planner.facts import HISTORY, MOTION_RECORD
from orientd.stream.records import JOINTS, MOVING, PATH_FLOATS, UNKNOWN, Command, ServoState

_log = logging.getLogger(__name__)

START_TOLERANCE = 1e-6
"""Largest distance of a kept plan's start from the commanded pose of the device, rad and m."""

_SAME_BRANCH = 0.5
"""How far axis angles as measured may be from those planned to be on the same branch, rad."""

ATTEMPTS = 6
"""Most plans of a motion if the device keeps passing the record where it should begin."""

LONGEST_STOP = 30.0
"""How long a stop on the path may take, s."""

_LATER_ATTEMPTS = 3
"""How often a later record on the way is tried: then a motion of shaped axes begins at rest."""

_LATER = ((0.0,), (0.0, 0.15), (0.0, 0.3))
"""Delays after which to leave the path if a motion cannot continue from the first record, s.

The planners try the delays of a row in parallel.  If they refuse all of them, the next row starts
from the newest cycle.
"""

_FIRST = 0.004
"""How long planning takes, s, before that has been measured."""

_LONGEST = 0.25
"""Longest replanning horizon, s, of a motion that has not been too late before."""

_KEPT, _RANK = 12, 2
_SHARE = 1.05

Kind = tuple[int, bool]
"""How many binary digits the size of a request has, and whether the motion is queued."""


class ReplanningHorizon:
    """How far ahead of the servo a new motion takes over, by the kind of plan.

    It covers the time from choosing the record until the servo can see the motion.  It is learnt
    from recent plans of the same kind.  The second longest of them counts, so that one delayed plan
    does not delay the next ones.
    """

    def __init__(self) -> None:
        self._taken: defaultdict[Kind, deque[float]] = defaultdict(lambda: deque(maxlen=_KEPT))

    def add(self, kind: Kind, seconds: float) -> None:
        """Take note of how long it took from choosing a record until the servo could see it."""
        self._taken[kind].append(seconds)

    def ahead(self, kind: Kind, late: Sequence[float] = ()) -> float:
        """Return how far ahead to take over, s.

        Args:
            kind: of plan.
            late: how long each attempt at the same motion took that came too late, s.  The next
                one has as long as the last of them took; from the second on, twice as long.
        """
        taken = sorted(self._taken[kind])
        expected = taken[-min(_RANK, len(taken))] if taken else _FIRST
        expected = max([expected, *late[-1:]])
        return min(_SHARE * expected, _LONGEST) * 2.0 ** max(0, len(late) - 1)


class Retargeting:
    """Plan the motions of one device, from where it is or will be, until one begins."""

    def __init__(
        self,
        servo: ServoProcess,
        queue: MotionQueue,
        planners: Planners,
        *,
        name: str,
        period: float,
        workers: DeviceWorkers,
    ) -> None:
        """Plan nothing yet.

        Args:
            servo: of the device.
            queue: the motions that it runs.
            planners: plan for it.
            name: of the device.
            period: of its cycle, s.
            workers: threads for its commands and its stops.
        """
        self._servo, self._queue, self._planners = servo, queue, planners
        self._name, self._period, self._workers = name, period, workers
        self._horizon = ReplanningHorizon()
        self._turn = asyncio.Lock()

    async def begin(
        self, queued: QueuedMotion, request: PlanRequest, start: Callable[[QueuedMotion], float]
    ) -> None:
        """Plan a motion and begin it.

        One motion at a time, in the order in which they come: where a motion begins changes when
        another one does.

        Args:
            queued: the motion.
            request: what it is to do.
            start: begins it, in a thread; returns when the servo could see it, monotonic s.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device cannot move, was stopped, or was too quick for every plan.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
            DeadlineError: the motions that were asked for before take too long.
        """
        late: list[float] = []
        problem = ""
        kind = request.size.bit_length(), queued.options.is_queued
        try:
            with request.waiting():
                async with asyncio.timeout(request.time_left):
                    await self._turn.acquire()
        except TimeoutError:
            raise DeadlineError(
                f"planning did not begin within {request.timeout:g} s: device {self._name} is "
                "being given motions that were asked for before"
            ) from None
        try:
            while len(late) < ATTEMPTS and request.time_left:
                begun = time.monotonic()
                try:
                    chosen = await self._plan(queued, request, kind, late)
                    queued.planned_ns = time.monotonic_ns()
                    posted = await self._workers.commands.run(start, queued)
                except NotYetError as error:
                    problem = str(error)
                    with request.waiting():
                        await self._await_steady()
                except LateError as error:
                    _log.info("%s: planned too late: %s", self._name, error)
                    late.append(time.monotonic() - begun)
                    problem = str(error)
                else:
                    queued.attempts = len(late) + 1
                    if queued.begins is not None:
                        self._horizon.add(kind, posted - chosen)
                    return
        finally:
            self._turn.release()
        raise StateError(f"device {self._name} was too quick for {len(late)} plans: {problem}")

    async def plan(self, request: PlanRequest) -> PlannedMotion:
        """Plan a motion that begins where the device will be once it has come to rest.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device is neither holding nor moving.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        cycle, queue = self._servo.newest(), self._queue
        if cycle is None or cycle.state not in MOVING or not queue.is_active:
            start = self._held()
        else:
            # A motion stopped a moment ago may not have been taken out yet.
            last = queue.last.motion
            end = (await self._tail(last, last.last_record))[-MOTION_RECORD.size :]
            joints = last.facts.last_joints or cycle.sent_joints or cycle.joints
            start = _at_rest(end, joints)
        return await self._planners.plan(request.beginning(self._name, start))

    def check_start(self, motion: PlannedMotion) -> None:
        """Refuse a kept plan unless it begins where the device, at rest, is commanded to be.

        Raises:
            StateError: the device is not holding.
            StartError: the motion begins with another orientation, position or axis angles.
        """
        here, begin = self._servo.commanded(), MOTION_RECORD.unpack(motion.read(0, 1))
        measured, joints = here.joints, motion.facts.first_joints
        turn = norm(difference(here.q, begin[:4]))
        away = max(abs(a - b) for a, b in zip(here.position, begin[10:13], strict=True))
        problem = ""
        if turn > START_TOLERANCE:
            problem = f"{turn:.6g} rad from where device {self._name!r} is commanded to be"
        elif len(measured) == len(joints) and any(
            abs(a - b) >= _SAME_BRANCH for a, b in zip(measured, joints, strict=True)
        ):
            problem = f"with other axis angles than those of device {self._name!r}"
        elif away > START_TOLERANCE:
            problem = f"{away:.6g} m from where device {self._name!r} is commanded to be"
        if problem:
            raise StartError(f"the motion begins {problem}; plan it again")

    # One attempt

    async def _plan(
        self, queued: QueuedMotion, request: PlanRequest, kind: Kind, late: Sequence[float]
    ) -> float:
        """Plan a motion and choose where it begins; return when that was chosen, monotonic s."""
        await self._await_stop(request)
        chosen, leave = time.monotonic(), self._choose(queued, kind, late)
        motion: PlannedMotion | None = None
        if leave is not None and queued.options.is_queued:
            left = self._left(leave)
            tail = await self._tail(left, leave.record)
            following = request.beginning(
                self._name,
                tail,
                after=left.facts,
                tolerance=queued.options.blend,
                earliest=leave.record,
            )
            motion = await self._planners.plan(following, rank=Rank.URGENT)
            leave = SplicePoint(leave.number, motion.leave)
        elif leave is not None:
            chosen, leave, motion = await self._take_over(queued, request, kind, late, leave)
        if motion is None:
            await self._await_stop(request)
            motion = await self._planners.plan(
                request.beginning(self._name, self._held(), tolerance=queued.options.blend)
            )
        await motion.arrive(self._queue.needed(motion.facts))
        queued.planned, queued.begins = motion, leave
        return chosen

    def _choose(
        self, queued: QueuedMotion, kind: Kind, late: Sequence[float]
    ) -> SplicePoint | None:
        """Return the earliest point to leave the running motion; ``None`` if nothing runs.

        Raises:
            StateError: the device cannot move.
        """
        queue, cycle = self._queue, self._servo.newest()
        if cycle is None or cycle.state is not ServoState.STREAMING:
            return None
        if queued.options.start_ns != UNKNOWN:
            raise StateError("the device is moving: a start time needs one at rest")
        if not queue.is_active:
            return None
        since = (time.monotonic_ns() - cycle.deadline_ns) * 1e-9
        horizon = since + self._horizon.ahead(kind, late)
        # The servo takes a command up before it moves on from the record of the cycle before.
        ahead = queue.ahead(cycle, max(0, math.ceil(horizon / self._period) - 1))
        if queued.options.is_queued and ahead.number != queue.last.number:
            return queue.end(record=0)
        return ahead

    async def _take_over(
        self,
        queued: QueuedMotion,
        request: PlanRequest,
        kind: Kind,
        late: Sequence[float],
        leave: SplicePoint,
    ) -> tuple[float, SplicePoint | None, PlannedMotion | None]:
        """Plan a motion from *leave* on, or from a record a little later.

        The planner may refuse all of them, for example on a passage near a singularity.  The device
        then stops on its path, unless the planner refuses a motion from rest there too.

        Returns:
            When the record was chosen, monotonic s; which one; and the motion.  ``None`` for both
            if the motion must begin at rest.
        """
        chosen, left = time.monotonic(), self._left(leave)
        is_shaped = bool(left.facts.first_joints)
        rows = _LATER if len(late) < _LATER_ATTEMPTS else () if is_shaped else _LATER[:1]
        if not leave.record:
            rows = _LATER[:1]  # at rest: the motion that runs waits for its start time
        refusal: PlanError | None = None
        for together in rows:
            ahead = [leave.record + round(seconds / self._period) for seconds in together]
            end = min(left.last_record, left.at_hand[1])
            records = [one for one in ahead if one < end or (one == leave.record and not is_shaped)]
            plans = [self._plan_from(request, left, record) for record in records]
            found: dict[int, PlannedMotion] = {}
            for record, motion in zip(
                records, await asyncio.gather(*plans, return_exceptions=True), strict=True
            ):
                if isinstance(motion, PlannedMotion):
                    found[record] = motion
                elif isinstance(motion, PlanError):
                    refusal = refusal or motion
                else:
                    raise motion
            if found:
                record = self._first_ahead(leave, found)
                return chosen, SplicePoint(leave.number, record), found[record]
            is_of_lead_in = isinstance(refusal, LimitError) and refusal.is_in_lead_in
            if refusal is not None and not (is_shaped or is_of_lead_in):
                try:
                    raise refusal
                finally:
                    # An error has this frame in its traceback: with names in it, both are kept.
                    del refusal, motion
            chosen, now = time.monotonic(), self._choose(queued, kind, late)
            if now is None:
                break
            leave, left = now, self._left(now)
        else:
            # Stop only if the motion can be planned from rest near there.
            start = _at_rest(left.read(leave.record, 1))
            await self._planners.plan(request.beginning(self._name, start))
        cycle = self._servo.newest()
        if cycle is not None and cycle.state is ServoState.STREAMING:
            await self._workers.stops.run(self._servo.ask, Command.STOP)
        await self._await_stop(request, MOVING)
        return chosen, None, None

    async def _plan_from(
        self, request: PlanRequest, left: PlannedMotion, record: int
    ) -> PlannedMotion:
        """Plan a motion that takes over from another one at a record of that."""
        taking_over = request.beginning(self._name, left.start_at(record))
        return await self._planners.plan(taking_over, rank=Rank.URGENT)

    def _first_ahead(self, leave: SplicePoint, found: dict[int, PlannedMotion]) -> int:
        """Return the first record that the servo has yet to come to, else the last of them."""
        cycle = self._servo.newest()
        here = leave if cycle is None else self._queue.ahead(cycle, 0)
        ahead = [one for one in found if here.number == leave.number and one > here.record]
        return min(ahead, default=max(found))

    def _left(self, leave: SplicePoint) -> PlannedMotion:
        """Return the motion to take over from.

        Raises:
            LateError: it has ended.
        """
        queued = self._queue.queued(leave.number)
        if queued is None:
            raise LateError(f"motion {leave.number} has ended")
        return queued.motion

    async def _tail(self, motion: PlannedMotion, earliest: int) -> bytes:
        """Return the last records of a motion, as far as one that follows it may need them."""
        first = motion.tail_record(earliest) - HISTORY
        begin, end = motion.at_hand
        if begin <= first and end == motion.facts.record_count:
            return motion.read(first, end - first)
        return await self._planners.records(motion, first)

    def _held(self) -> bytes:
        """Return the record in which the device holds.

        Raises:
            StateError: the device is not holding.
        """
        cycle = self._servo.commanded()
        return record_at_rest(cycle.q, cycle.position, cycle.sent_joints or cycle.joints)

    # Waiting for the device

    async def _await_stop(
        self, request: PlanRequest, states: Sequence[ServoState] = (ServoState.STOPPING,)
    ) -> None:
        """Wait until a stop that is under way has come to its end, out of *states*.

        Raises:
            StateError: the device does not come to rest.
        """
        end = time.monotonic() + LONGEST_STOP
        with request.waiting():
            while (cycle := self._servo.newest()) and cycle.state in states:
                if time.monotonic() > end:
                    raise StateError("the device does not come to rest")
                await asyncio.sleep(self._period)

    async def _await_steady(self) -> None:
        """Wait while the speed along the path is changing.

        Raises:
            StateError: the speed keeps changing.
        """
        end, before = time.monotonic() + LONGEST_STOP, self._servo.newest()
        while time.monotonic() < end:
            await asyncio.sleep(self._period)
            now = self._servo.newest()
            if now is None or now.state is not ServoState.STREAMING:
                return
            if before is not None and now.index > before.index and now.speed == before.speed:
                return
            before = now
        raise StateError("the device does not come to a steady speed")


def _at_rest(record: bytes, joints: Joints = ()) -> bytes:
    """Return a record at rest where another one is.

    Args:
        record: of a motion.
        joints: axis angles, rad, of a record that has none.
    """
    fields = MOTION_RECORD.unpack(record)
    planned = fields[PATH_FLOATS - 2 * JOINTS : PATH_FLOATS - JOINTS]
    known = tuple(angle for angle in planned if not math.isnan(angle))
    return record_at_rest(fields[:4], fields[10:13], known or joints)
