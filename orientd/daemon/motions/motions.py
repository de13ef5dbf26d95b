"""The motions of one device: planned from where it is or will be, begun, fed, measured, ended.

One for each servo process.  Not locked: the device calls it with its own lock held, except for
planning, which takes its time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from orientd.daemon.devices import STOPPED, EventKind, ServoLink
from orientd.daemon.motions.arrivals import Arrivals
from orientd.daemon.motions.coming_to_rest import await_rest, await_steady, stop_on_path
from orientd.daemon.motions.corners import Corners, Tell
from orientd.daemon.motions.horizon import ReplanningHorizon
from orientd.daemon.motions.motion_queue import MotionQueue
from orientd.daemon.motions.options import Kind, MoveOptions, Prepared
from orientd.daemon.motions.queued_motion import QueuedMotion, SplicePoint
from orientd.daemon.motions.takeover import Takeover
from orientd.daemon.planners import PlanCall, PlanInput, PlannedMotion, Planners, Rank
from orientd.errors import LateError, NotYetError, StateError
from orientd.planner import HISTORY, RecordedMotion
from orientd.planner import State as PlannedState
from orientd.rpc import control_pb2 as pb
from orientd.stream import UNKNOWN, Command, Cycle, ServoState


class Motions:
    """What one servo process runs, and is to run; *is_paused* where that stands on its path."""

    def __init__(
        self,
        link: ServoLink,
        name: str,
        planners: Planners,
        *,
        period: float,
        lead: float,
        read_ahead: int,
        tell: Tell,
    ) -> None:
        """Begin with none.

        Args:
            link: to the servo.
            name: of the device.
            planners: plan for it.
            period: of the device, s.
            lead: by how much it is led, s.
            read_ahead: path records to keep ahead of the servo.
            tell: is told of everything that happens to a motion.
        """
        self.is_paused = False
        self._link = link
        self._name, self._planners = name, planners
        self._period = period
        self._queue = MotionQueue(link, lead=lead, read_ahead=read_ahead)
        self._takeover = Takeover(link, name, planners, self._queue, period)
        self.withdraw = self._queue.withdraw  # of what waits for its turn
        self._arrivals = Arrivals(link, tell)
        self._corners = Corners(tell)
        self._tell = tell
        self._tuned: Mapping[str, Any] = {}
        self._horizon = ReplanningHorizon()
        self._shown: QueuedMotion | None = None
        self._is_closed = False

    # Planning

    async def plan(self, order: PlanCall) -> PlannedMotion:
        """Plan a motion that begins where the device will be once it has come to rest.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device is neither holding nor moving.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        cycle = self._link.newest()
        is_moving = cycle is not None and cycle.state in (ServoState.STREAMING, ServoState.STOPPING)
        # A motion stopped a moment ago may not have been taken out yet.
        last = self._queue.last if is_moving and self._queue.is_active else None
        if last is None:
            start, joints = self.held(), self._joints()
        else:
            tail = await self._tail(last.motion, last.motion.last_record)
            start = tail.state_at(last.motion.last_record)
            joints = last.motion.facts.last_joints or self._joints()
        plan_input = PlanInput(self._name, order.motion, start=start, joints=joints)
        return await self._planners.plan(plan_input, order)

    async def prepare(
        self, order: PlanCall, move_options: MoveOptions, *, attempt: int
    ) -> Prepared:
        """Plan a motion for :meth:`start`: from rest, or from a point of the path a little ahead.

        Args:
            order: what to do.
            move_options: how to begin and to end.
            attempt: how often :meth:`start` has said already that it was too late.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            LateError: what it was to follow has ended.
            StateError: the device cannot move.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        kind = len(order.motion).bit_length(), move_options.is_queued
        await self._rest(order)
        leave = await self._leave(order, move_options, kind, attempt)
        chosen = time.monotonic()
        motion: PlannedMotion | None = None
        if leave is not None and move_options.is_queued:
            left = self._takeover.left(leave)
            tail = await self._tail(left, leave.record)
            plan_input = PlanInput(
                self._name,
                order.motion,
                after=tail,
                tolerance=move_options.blend,
                earliest=leave.record,
            )
            motion = await self._planners.plan(plan_input, order, rank=Rank.URGENT)
            leave = replace(leave, record=motion.leave)
        elif leave is not None:
            choose = partial(self._leave, order, move_options, kind, attempt)
            successor = await self._takeover.plan(order, leave, choose, attempt)
            if successor is not None:
                leave, motion, chosen = successor
        if motion is None:
            if leave is not None:
                leave = None
                with order.waiting():
                    await stop_on_path(self._link, self._period)
            start, joints = self.held(), self._joints()
            plan_input = PlanInput(self._name, order.motion, start=start, joints=joints)
            motion = await self._planners.plan(plan_input, order)
        await motion.arrive(self._queue.needed(motion.facts))
        return Prepared(motion, leave, move_options, chosen, kind)

    async def _rest(self, order: PlanCall) -> None:
        """Wait for the end of a stop."""
        cycle = self._link.newest()
        if cycle is not None and cycle.state is ServoState.STOPPING:
            with order.waiting():
                await await_rest(self._link, self._period)

    async def await_steady(self) -> None:
        """Wait while the speed along the path is changing.

        Raises:
            StateError: it goes on changing.
        """
        await await_steady(self._link, self._period)

    async def _tail(self, motion: PlannedMotion, earliest: int) -> RecordedMotion:
        """Return the end of a motion, as far as one that follows it may need it."""
        first = max(0, motion.tail_record(earliest) - HISTORY)
        begin, end = motion.at_hand
        if begin <= first and end == motion.facts.record_count:
            rows = motion.rows(first, end - first)
        else:
            rows = await self._planners.records(motion, first)
        return RecordedMotion(motion.facts, rows, first)

    def held(self) -> PlannedState:
        """Return where the device holds.

        Raises:
            StateError: it does not hold.
        """
        cycle = self._link.newest()
        if cycle is None or cycle.state is not ServoState.HOLDING:
            raise StateError("the device does not hold")
        return PlannedState.at_rest(cycle.q, cycle.position)

    async def _leave(
        self, order: PlanCall, move_options: MoveOptions, kind: Kind, attempt: int
    ) -> SplicePoint | None:
        """Return where what runs is to be left at the earliest; ``None`` where nothing runs."""
        motion_queue, cycle = self._queue, self._link.newest()
        if cycle is None or cycle.state not in (ServoState.STREAMING, ServoState.STOPPING):
            return None
        if move_options.start_ns != UNKNOWN:
            raise StateError("the device is moving: a start time needs one at rest")
        if cycle.state is ServoState.STOPPING:
            await self._rest(order)
            return None
        if not motion_queue.is_active:
            return None
        since = (time.monotonic_ns() - cycle.deadline_ns) * 1e-9
        horizon = since + self._horizon.ahead(kind, attempt)
        # It takes a command up before it moves on from the record of the cycle before.
        ahead = motion_queue.ahead(cycle, max(0, math.ceil(horizon / self._period) - 1))
        if move_options.is_queued and ahead.number != motion_queue.last.number:
            return motion_queue.end(record=0)
        return ahead

    def _joints(self) -> tuple[float, ...]:
        """Return the axis angles that were sent last, or else those measured."""
        cycle = self._link.newest()
        return () if cycle is None else cycle.sent_joints or cycle.joints

    # Running

    def start(self, prepared: Prepared, number: int, *, speed: float) -> None:
        """Begin to stream a motion as number *number*, at *speed*.

        A motion that is to follow others is taken up when its turn has come.

        Raises:
            LateError: the device has passed the point at which it was to begin.
            StateError: the device is not holding, or not where the motion begins.
        """
        motion, leave, move_options = prepared.motion, prepared.leave, prepared.move_options
        options = motion.facts.device_options
        if leave is None:
            if self._queue.is_active:
                raise LateError("a motion that was to follow has begun")
            move_options.check_start_time()
            if options != self._tuned:
                self._link.tune(options)
                self._tuned = options
            self._arrivals.end("another motion began", EventKind.MOTION_PASSED)
            self._queue.begin(motion, number, speed=speed, start_ns=move_options.start_ns)
            self.is_paused = False
        elif options != self._tuned:
            raise StateError("device_options change at rest only: wait for the motion's end")
        elif move_options.is_queued:
            self._horizon.add(prepared.kind, time.monotonic() - prepared.chosen)
            self._queue.append(motion, number, leave)
        else:
            self._horizon.add(prepared.kind, time.monotonic() - prepared.chosen)
            for queued in self._queue.replace(motion, number, leave):
                self._tell(EventKind.MOTION_REPLACED, queued.number, "before it began")
            if self.is_paused:
                self._link.ask(Command.SPEED, speed=speed)
                self.is_paused = False
        if move_options.gate is not None:
            self._arrivals.expect(number, move_options.gate)
        at_speed = "" if speed == 1.0 else f" at speed {speed:g}"
        self._tell(EventKind.MOTION_STARTED, number, f"{motion.facts.duration:.3f} s{at_speed}")

    def tend(self, fault_text: str, *, speed: float) -> None:
        """Feed what runs, measure it, and note what has ended; to be called every few cycles.

        Args:
            fault_text: why the device is in a fault, if it is.
            speed: at which a motion goes on that was to follow one that has come to rest.

        Raises:
            DaemonError: the servo does not answer.
        """
        self._arrivals.look(fault_text)
        motion_queue = self._queue
        if not motion_queue.is_active:
            return
        try:
            motion_queue.feed()
        except NotYetError:
            pass  # tried again with the next look
        except LateError as error:
            for queued in motion_queue.miss():
                self._tell(EventKind.MOTION_STOPPED, queued.number, str(error))
        cycle = self._link.newest()
        motion_queue.measure_some()
        if cycle is None or (cycle.state is ServoState.FAULT and not fault_text):
            return  # the reason for a fault of this very moment comes before the next look
        self._corners.look(motion_queue.passed(cycle), motion_queue.first, cycle)
        is_moving = cycle.state in (ServoState.STREAMING, ServoState.STOPPING)
        if cycle.motion == motion_queue.first.number and not is_moving:
            self._conclude(cycle, fault_text, speed)

    def _conclude(self, cycle: Cycle, fault_text: str, speed: float) -> None:
        """Note how the motion ended that has come to rest, and those that were to follow it."""
        self.is_paused = False
        ended, *following = self._queue.clear()
        is_fault = cycle.state is ServoState.FAULT
        is_at_end = ended.feeder is not None and cycle.path_index == ended.feeder.final_index
        self._corners.end(fault_text if is_fault else "")
        if is_fault or not is_at_end:
            text = fault_text if is_fault else ended.withdrawn or STOPPED
            self._stop((ended, *following), text)
            return
        self._arrivals.arrive(ended.number, cycle, is_followed=bool(following))
        if following:
            # It came to rest before the servo had heard of the next one.
            try:
                self._queue.resume(following, speed=speed)
            except StateError as error:
                self._stop(tuple(following), str(error))

    def drop(self, text: str, *, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Say of every motion that it has ended."""
        self._arrivals.end(text, kind)
        self._corners.end(text, kind)
        self._stop(tuple(self._queue.clear()), text, kind)

    def _stop(
        self, ended: tuple[QueuedMotion, ...], text: str, kind: EventKind = EventKind.MOTION_STOPPED
    ) -> None:
        for queued in ended:
            self._tell(kind, queued.number, text)

    def close(self) -> None:
        """Look at the servo's cycles for the last time; its memory is about to go."""
        self._queue.measure()
        self._is_closed = True

    # What there is to see

    @property
    def present(self) -> int:
        """Number of the motion that runs; 0 for none."""
        return self._queue.first.number if self._queue.is_active else 0

    def queued_of(self, cycle: Cycle | None) -> QueuedMotion | None:
        """Return the motion that a cycle belongs to, or the one that was there last."""
        queued = self._queue.queued(cycle.motion) if cycle is not None else None
        if queued is not None:
            self._shown = queued
        shown = self._shown
        # A motion begins before it is entered here: until then there is nothing to say of it.
        return shown if shown is None or cycle is None or shown.number == cycle.motion else None

    def queued(self, number: int) -> QueuedMotion | None:
        """Return a motion that is under way or waits for its turn."""
        return self._queue.queued(number)

    def settled_after(self, number: int) -> float | None:
        """Return how long after its last setpoint motion *number* was on target, s, if it was."""
        return self._arrivals.settled_after(number)

    def figures(self, number: int) -> tuple[pb.MotionStatistics | None, int | None]:
        """See :meth:`.MotionQueue.figures`; up to the newest cycle."""
        if not self._is_closed:
            self._queue.measure()
        return self._queue.figures(number)
