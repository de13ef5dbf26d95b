"""The motion queue of one device: the motion that its servo runs, and the motions that follow it.

A queued motion begins where the one before is left: at a record on its way, if it is replaced or
blended into the next, or at its last one.  The queue feeds a motion into the path ring once the one
before is in there as far as it will be.  Then it tells the servo of the splice.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

from orientd.daemon.device.endings import Endings, Tell
from orientd.daemon.device.event import EventKind
from orientd.daemon.device.feeder import BLOCK, MARGIN, Feeder
from orientd.daemon.device.meter import MotionMeter
from orientd.daemon.device.queued_motion import QueuedMotion, SplicePoint
from orientd.daemon.device.servo_process import ServoProcess
from orientd.errors import DaemonError, LateError, NotYetError, OrientdError, StateError
from orientd.model.limits import Limits
from orientd.planner.facts import MotionFacts
from orientd.stream.records import (
    MOVING,
    TAIL_WORD,
    UNKNOWN,
    Command,
    Cycle,
    ServoLimits,
    ServoState,
    records_to_stop,
)

_SOON = 1.0
"""How long before its start time the servo hears of the motion after a waiting one, s."""
_FEED_TIME = 0.25
"""Path time, beyond that of a stop, that is fed before the servo gets a new motion, s."""


STOPPED = "stopped on its path"
"""Text of a motion that was stopped, if there is no more to say of it than why."""

LEFT = "the servo has left it for a motion that it had seemed not to take: its answer came too late"
"""Text of a motion that the servo left without the daemon's knowledge."""


class MotionQueue:
    """The motions of a device, in order; the servo is on one of them or on its way to the first.

    The device holds its lock while it calls methods that change the queue.

    Attributes:
        speed: speed of motions relative to the planned one.
        is_paused: whether a motion is paused on its path.
    """

    def __init__(self, servo: ServoProcess, tell: Tell, *, lead: float, read_ahead: int) -> None:
        """Begin with nothing.

        Args:
            servo: runs the motions.
            tell: called for each event of a motion.
            lead: latency compensation of the device, s.
            read_ahead: how many records to keep ahead of the servo.
        """
        self.speed, self.is_paused = 1.0, False
        self._servo, self._tell = servo, tell
        self._endings = Endings(servo, tell)
        self._lead = lead
        self._read_ahead = read_ahead
        self._motions: list[QueuedMotion] = []
        self._targets: QueuedMotion | None = None
        self._shown: QueuedMotion | None = None
        self._tuned: Mapping[str, Any] = {}
        self._meters: list[MotionMeter] = []
        self._braked = UNKNOWN  # the newest cycle when the servo was last told to brake

    def restart(self) -> None:
        """Clear the state for a new servo process, which has no motion."""
        self._targets = self._shown = None
        self._tuned, self.is_paused = {}, False

    # What there is

    @property
    def is_active(self) -> bool:
        """Whether there is a motion that has not ended."""
        return bool(self._motions)

    @property
    def first(self) -> QueuedMotion:
        """The queued motion that the servo is on."""
        return self._motions[0]

    @property
    def last(self) -> QueuedMotion:
        """The queued motion after which nothing is planned yet."""
        return self._motions[-1]

    def queued(self, number: int) -> QueuedMotion | None:
        """Return the queued motion of motion *number*, if it has not ended."""
        return next((queued for queued in self._motions if queued.number == number), None)

    @property
    def present(self) -> QueuedMotion | None:
        """The motion that the device is on."""
        return self._motions[0] if self._motions else self._targets

    def shown(self, cycle: Cycle | None) -> QueuedMotion | None:
        """Return the motion that a cycle belongs to, or the one that was there last."""
        queued = self.queued(cycle.motion) if cycle is not None else None
        if queued is not None:
            self._shown = queued
        shown = self._shown
        # A motion begins before it is in the queue: until then there is nothing to say of it.
        return shown if shown is None or cycle is None or shown.number == cycle.motion else None

    def ahead(self, cycle: Cycle, records: int) -> SplicePoint:
        """Return where the servo will be *records* after *cycle*.

        Raises:
            LateError: all motions have ended meanwhile.
        """
        motions = self._motions[:]
        if not motions:
            raise LateError("the running motion has ended")
        first = motions[0]
        if first.is_waiting(records * first.motion.facts.period):
            return SplicePoint(first.number, 0)
        place = next((k for k, s in enumerate(motions) if s.number == cycle.motion), 0)
        queued = motions[place]
        here = 0
        if queued.number == cycle.motion and queued.first_index is not None:
            here = max(0, cycle.path_index - queued.first_index)
        while here + records > queued.last_record and place + 1 < len(motions):
            if not motions[place + 1].is_running:
                break  # not in the ring: the servo cannot leave it yet
            records -= max(0, queued.last_record - here)
            place, here = place + 1, 0
            queued = motions[place]
        record = here + records
        if record >= queued.last_record:
            # At its last record a motion has come to rest, but its differences have not.
            record = queued.motion.rest_record if queued.leave is None else queued.leave
        return SplicePoint(queued.number, record)

    def end(self, record: int) -> SplicePoint:
        """Return the last queued motion at *record*.

        Raises:
            StateError: it is not to be run to its end.
        """
        if self.last.reason:
            raise StateError(
                f"motion {self.last.number}, which this was to follow, ends early: "
                f"{self.last.reason}"
            )
        return SplicePoint(self.last.number, record)

    # Motions

    def start(self, queued: QueuedMotion) -> float:
        """Begin to stream a planned motion, or put it where its turn will come.

        Returns:
            When the servo could see it, monotonic s.

        Raises:
            LateError: the device has passed the point at which it was to begin.
            StateError: the device is not holding, or not where the motion begins.
            DaemonError: the servo does not answer.
        """
        leave, tuning = queued.begins, queued.motion.facts.device_options
        if leave is None:
            self.tend()
            if self._motions:
                raise LateError("a queued motion has begun")
            self._servo.commanded()
            late = (time.monotonic_ns() - queued.options.start_ns) * 1e-9
            if queued.options.start_ns != UNKNOWN and late > 0.0:
                raise StateError(f"the motion was ready {late:.3f} s after its start time")
            if tuning != self._tuned:
                self._servo.tune(tuning)
                self._tuned = tuning
            self._endings.end("another motion began", EventKind.MOTION_PASSED)
            posted = self.begin(queued)
            self.is_paused = False
        elif tuning != self._tuned:
            raise StateError("device_options change at rest only: wait for the motion's end")
        elif queued.options.is_queued:
            self.append(queued, leave)
            posted = time.monotonic()
        else:
            dropped, posted = self.replace(queued, leave)
            for one in dropped:
                self._tell(EventKind.MOTION_REPLACED, one, "before it began")
            if self.is_paused:
                self.unpause()
        return posted

    def track(self, queued: QueuedMotion, servo_limits: ServoLimits) -> None:
        """Follow targets, whatever moves at present.

        Raises:
            StateError: the device is neither holding nor moving, or cannot follow targets.
            DaemonError: the servo does not answer.
        """
        self._servo.ask(Command.TRACK, motion=queued.number, servo_limits=servo_limits)
        self.drop("by targets to follow", EventKind.MOTION_REPLACED)
        self._targets, self.is_paused = queued, False

    def pause(self) -> None:
        """Come to rest on the path until :meth:`unpause`."""
        self._servo.ask(Command.SPEED, speed=0.0)
        self.is_paused = True

    def unpause(self) -> None:
        """Resume after :meth:`pause`, at the set speed."""
        self._servo.ask(Command.SPEED, speed=self.speed)
        self.is_paused = False

    def set_speed(self, speed: float) -> None:
        """Run at another speed, now and from now on."""
        self._servo.running()
        cycle = self._servo.newest()
        if cycle is not None and cycle.state is ServoState.STREAMING and not self.is_paused:
            self._servo.ask(Command.SPEED, speed=speed)
        self.speed = speed

    def begin(self, queued: QueuedMotion) -> float:
        """Start a motion on a device that holds; return when the servo could see it, monotonic s.

        Raises:
            StateError: the servo does not take it.
            DaemonError: the servo does not answer.
        """
        feeder = self._feed_first(queued, is_at_rest=True)
        start_ns = UNKNOWN if queued.begins is not None else queued.options.start_ns
        posted = self._command(Command.START, queued, feeder, speed=self.speed, start_ns=start_ns)
        self._motions = [queued]
        return posted

    def replace(self, queued: QueuedMotion, leave: SplicePoint) -> tuple[list[QueuedMotion], float]:
        """Replace everything after *leave* by a motion.

        Returns:
            The motions that are dropped, and when the servo could see the new one, monotonic s.

        Raises:
            LateError: the servo has passed that record, or moves no more.
            DaemonError: the servo does not answer.
        """
        left = self.queued(leave.number)
        if left is None or left.feeder is None:
            raise LateError(f"motion {leave.number} has ended")
        posted = self._splice(queued, left, leave.record)
        place = self._motions.index(left)
        dropped = self._motions[place + 1 :]
        left.leave, left.is_replaced = leave.record, True
        left.feeder.leave_at(leave.record)
        self._motions[place + 1 :] = [queued]
        self._let_go(dropped)
        return dropped, posted

    def append(self, queued: QueuedMotion, leave: SplicePoint) -> None:
        """Append a motion to the last queued motion, from *leave* on.

        The servo learns of it at once if the motion before it is in the ring.

        Raises:
            LateError: the last queued motion is another one by now, or the servo has passed
                *leave* or cannot go over to another one at this moment.
        """
        if not self._motions or self.last.number != leave.number or self.last.leave is not None:
            raise LateError(f"motion {leave.number} is not the last one any more")
        left = self.last
        left.leave = leave.record
        self._motions.append(queued)
        try:
            self.feed()
        except StateError as error:
            if isinstance(error, LateError) and leave.record >= left.motion.last_record:
                return  # it begins when the one before has come to rest
            self._take_out(len(self._motions) - 1)
            raise
        except DaemonError:
            return  # the next look finds out about a servo that does not answer

    def feed(self) -> None:
        """Fill the ring, and tell the servo of the next motion once it is in there.

        Raises:
            LateError: the servo has passed the record where the next motion begins, or moves no
                more.
            DaemonError: the servo does not answer.
        """
        left: QueuedMotion | None = None
        for queued in self._motions:
            if left is not None and queued.feeder is None:
                if self.first.is_waiting(_SOON):
                    return  # the servo cannot forget a motion again
                self._follow(queued, left)
            feeder, last = queued.feeder, queued.leave
            if feeder is None:
                return
            if last is None:
                last = queued.motion.rest_record
            while not feeder.has(last) and feeder.feed(BLOCK) == BLOCK:
                self._servo.beat()
            if not feeder.has(last):
                return
            left = queued

    def _follow(self, queued: QueuedMotion, left: QueuedMotion) -> None:
        """Put *queued* after *left*; the ring keeps the rest of *left* until the servo changes.

        Raises:
            LateError: the servo has passed the record where *left* is left, or moves no more.
        """
        try:
            self._splice(queued, left, left.last_record)
        except NotYetError:
            # A stop must fit meanwhile, which may end beyond the record where it is left.
            ring = self._servo.running().path
            fed = ring.head - ring.words[TAIL_WORD]
            if left.feeder is not None and fed < self.needed(left.motion.facts):
                left.feeder.feed(BLOCK)
            raise
        if left.feeder is not None:
            left.feeder.leave_at(left.last_record)

    def miss(self) -> list[QueuedMotion]:
        """Remove the motions that reached the servo too late, unless they follow at rest."""
        place = next(k for k, queued in enumerate(self._motions) if not queued.is_running)
        left = self._motions[place - 1]
        if left.last_record >= left.motion.last_record:
            return []  # it begins when the one before has come to rest
        return self._take_out(place)

    def withdraw(self, withdrawn: QueuedMotion, reason: str) -> bool:
        """Take out a motion that waits for its turn, and what follows it.

        One that the servo has heard of is left, to be stopped once the one before is behind.

        Returns:
            Whether that was so; else it is that motion's turn already, or it has ended.
        """
        if withdrawn not in self._motions[1:]:
            return False
        place = self._motions.index(withdrawn)
        for queued in self._motions[place:]:
            queued.reason = queued.reason or reason
        if not withdrawn.is_running:
            self._stop(self._take_out(place), reason)
        return True

    def _take_out(self, place: int) -> list[QueuedMotion]:
        """Take out the motions from *place* on, so that the one before runs to its end."""
        left = self._motions[place - 1]
        out, self._motions = self._motions[place:], self._motions[:place]
        self._let_go(out)
        left.leave = None
        if left.feeder is not None:
            left.feeder.leave_at(left.motion.rest_record)
        return out

    def tend(self) -> None:
        """Feed the running motions, and note ended ones; call this every few cycles.

        Raises:
            DaemonError: the servo does not answer.
        """
        fault_text, cycle = self._servo.fault_text, self._servo.newest()
        if self._targets is not None and cycle is not None:
            self._look_at_targets(self._targets, cycle)
        self._endings.look(fault_text)
        if not self._motions:
            return
        try:
            self.feed()
        except NotYetError:
            pass  # tried again with the next look
        except LateError as error:
            self._stop(self.miss(), str(error))
        cycle = self._servo.newest()
        if cycle is None or (cycle.state is ServoState.FAULT and not fault_text):
            return  # the reason for a fault of this very moment comes before the next look
        self._endings.leave(self.passed(cycle), self.first, cycle)
        is_on_first = self._reaches(cycle)
        if cycle.state in MOVING or not self._motions:
            return
        if is_on_first:
            self._come_to_rest(cycle, fault_text)
        elif cycle.motion > self.last.number:
            self.is_paused = False
            self.drop(fault_text or LEFT)

    def _reaches(self, cycle: Cycle) -> bool:
        """Note how far along the first motion the device is; return whether it is on it."""
        is_on_it = bool(self._motions) and cycle.motion == self.first.number
        if is_on_it:
            self.first.reached = self.first.path_time(cycle)
        return is_on_it

    def _look_at_targets(self, queued: QueuedMotion, cycle: Cycle) -> None:
        """Report the end of tracking when the device has come to rest."""
        is_following = cycle.state in (ServoState.TRACKING, ServoState.STOPPING)
        if cycle.motion == queued.number and not is_following:
            self._targets = None
            is_fault = cycle.state is ServoState.FAULT
            text = self._servo.fault_text if is_fault else "the targets have ended"
            self._tell(EventKind.MOTION_STOPPED, queued, text)

    def _come_to_rest(self, cycle: Cycle, fault_text: str) -> None:
        """Note how the motion that has come to rest ended, and the queued ones behind it."""
        self.is_paused = False
        ended, *following = self.clear()
        is_fault = cycle.state is ServoState.FAULT
        self._endings.come_to_rest(fault_text if is_fault else "")
        behind = cycle.path_index - ended.final_index
        if is_fault or behind < 0:
            self._stop([ended, *following], fault_text if is_fault else STOPPED)
            return
        self._endings.arrive(ended, cycle, is_followed=bool(following))
        if behind:
            self._stop(following, STOPPED)
        elif following:
            # It came to rest before the servo had heard of the next one.
            try:
                self.begin(following[0])
            except StateError as error:
                self._stop(following, str(error))
            else:
                self._motions += following[1:]

    def drop(self, text: str, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Report the end of every motion."""
        targets, self._targets = self._targets, None
        if targets is not None:
            self._tell(EventKind.MOTION_STOPPED, targets, text)
        self._endings.end(text, kind)
        self._endings.come_to_rest(text, kind)
        last = self._servo.last()
        if last is not None:
            self._reaches(last)
        self._stop(self.clear(), text, kind)

    def _stop(
        self, ended: list[QueuedMotion], text: str, kind: EventKind = EventKind.MOTION_STOPPED
    ) -> None:
        for queued in ended:
            self._tell(kind, queued, text)

    def measure(self) -> None:
        """Add the cycles since the last look to the measurements; in any thread, without a lock."""
        for meter in self._meters[:]:
            if meter.measure():
                self._meters.remove(meter)

    def passed(self, cycle: Cycle) -> list[QueuedMotion]:
        """Take out the motions that the servo has left behind by *cycle*, and return them."""
        place = next((k for k, s in enumerate(self._motions) if s.number == cycle.motion), 0)
        passed, self._motions = self._motions[:place], self._motions[place:]
        self._let_go(passed)
        if self._motions and self.first.reason and cycle.state is ServoState.STREAMING:
            self._brake(cycle)
        return passed

    def _brake(self, cycle: Cycle) -> None:
        """Tell the servo to stop on its path, once for each of its cycles.

        The servo takes one command in each.  More stops would displace other commands while it
        stands still, and delay them afterwards.
        """
        if cycle.index != self._braked:
            self._braked = cycle.index
            self._servo.brake()

    def clear(self) -> list[QueuedMotion]:
        """Take out all queued motions, and return them."""
        motions, self._motions = self._motions, []
        self._let_go(motions)
        return motions

    # How

    def _let_go(self, motions: list[QueuedMotion]) -> None:
        for queued in motions:
            queued.let_go()

    def _splice(self, queued: QueuedMotion, left: QueuedMotion, record: int) -> float:
        """Put the beginning of a motion into the ring and have the servo go over to it.

        Returns:
            When the servo could see it, monotonic s.
        """
        ring = self._servo.running().path
        head = ring.head
        try:
            feeder = self._feed_first(queued, is_at_rest=False)
            leave_index = (left.first_index or 0) + record
            posted = self._command(Command.SPLICE, queued, feeder, leave_index=leave_index)
        except OrientdError as error:
            # The servo does not know these records; the next ones overwrite them.
            ring.advance(head)
            queued.feeder = queued.first_index = None
            if isinstance(error, LateError | DaemonError):
                raise
            raise LateError(str(error)) from error
        return posted

    def needed(self, facts: MotionFacts) -> int:
        """Return how many records of a motion the servo wants to see before it begins."""
        rates = [queued.motion.facts.brake_rate for queued in self._motions if queued.is_running]
        slowest = min([*rates, facts.brake_rate])
        more = math.ceil(_FEED_TIME / facts.period)
        return 1 + records_to_stop(slowest, facts.period) + more

    def _feed_first(self, queued: QueuedMotion, *, is_at_rest: bool) -> Feeder:
        """Put as much of a motion into the ring as the servo wants to see before it begins.

        Until what ran before is behind, the slowest stop of them all must fit.

        Raises:
            NotYetError: the ring has no room for so much.
        """
        ring, usual = self._servo.running().path, self._read_ahead
        needed = self.needed(queued.motion.facts)
        # Half of the usual bridges the daemon's own stalls, whatever a stop takes.
        ahead = min(max(usual, needed + usual // 2), ring.capacity - MARGIN)
        feeder = Feeder(ring, queued.motion, read_ahead=ahead)
        queued.feeder, queued.first_index = feeder, feeder.first_index
        if is_at_rest:
            feeder.clear()
        # Whole blocks: what is beyond the needed ones bridges a stall before the next look.
        while not feeder.is_done and ring.head - feeder.first_index < needed:
            if not feeder.feed(min(BLOCK, needed), is_urgent=True):
                raise NotYetError("motions replaced before they began fill the path ring")
        return feeder

    def _command(
        self,
        command: Command,
        queued: QueuedMotion,
        feeder: Feeder,
        *,
        speed: float = 0.0,
        start_ns: int = UNKNOWN,
        leave_index: int = UNKNOWN,
    ) -> float:
        """Tell the servo of a motion; return when it could see that, monotonic s."""
        facts, cycles = queued.motion.facts, self._servo.running().cycles
        meter = MotionMeter(
            queued.motion, queued.number, feeder.first_index, cycles, lead=self._lead
        )
        self._servo.beat()
        posted = self._servo.ask(
            command,
            motion=queued.number,
            path_index=feeder.first_index,
            leave_index=leave_index,
            final_index=queued.final_index if feeder.is_whole else UNKNOWN,
            start_ns=start_ns,
            speed=speed,
            servo_limits=servo_limits_of(facts.limits, facts.brake_rate),
        )
        queued.is_running, queued.meter = True, meter
        self._meters.append(meter)
        feeder.begin()
        return posted


def servo_limits_of(
    limits: Limits, brake_rate: float, path_tolerance: float = math.inf
) -> ServoLimits:
    """Return what the servo is to keep."""
    return ServoLimits(
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.linear_velocity,
        limits.linear_acceleration,
        brake_rate,
        limits.axis_velocity,
        limits.axis_acceleration,
        limits.axis_jerk,
        path_tolerance,
    )
