"""The motion queue of one device: the motion that its servo runs, and what follows it.

Every motion is a queued motion.  The next queued motion begins where the one before is left: at a
record on its way, where it is replaced or blended into the next, or at its last one.  A queued
motion is fed into the path ring once the one before has been, as far as it will be; then the servo
is told of the splice.
"""

from __future__ import annotations

from collections import OrderedDict

from orientd.daemon.devices import ServoLink, servo_limits_of
from orientd.daemon.motions.feeder import BLOCK, MARGIN, Feeder
from orientd.daemon.motions.meter import MotionMeter
from orientd.daemon.motions.queued_motion import QueuedMotion, SplicePoint
from orientd.daemon.planners import PlannedMotion
from orientd.errors import DaemonError, LateError, NotYetError, OrientdError, StateError
from orientd.planner import MotionFacts
from orientd.rpc import control_pb2 as pb
from orientd.servo import TAIL_WORD
from orientd.stream import UNKNOWN, Command, Cycle, ServoState, record_index

MEASURED = 16
"""Motions that have ended whose measurements are kept."""

_METER_BLOCK = 256
"""Cycles measured at a time: few of them would cost nearly as much as so many."""

_FEED_TIME = 0.25
"""How much of a motion is fed before the servo is told of it, beyond what a stop takes; s."""


class MotionQueue:
    """The motions of a device, in order; the servo is on one of them or on its way to the first."""

    def __init__(self, link: ServoLink, *, lead: float, read_ahead: int) -> None:
        """Begin with nothing.

        Args:
            link: to the servo.
            lead: by how much the device is led, s.
            read_ahead: how many records to keep ahead of the servo.
        """
        self._link = link
        self._lead = lead
        self._read_ahead = read_ahead
        self._queued_motions: list[QueuedMotion] = []
        self._meters: dict[int, MotionMeter] = {}
        self._measured: OrderedDict[int, tuple[pb.MotionStatistics, int | None]] = OrderedDict()
        self._metered = 0

    # What there is

    @property
    def is_active(self) -> bool:
        """Whether there is a motion that has not ended."""
        return bool(self._queued_motions)

    @property
    def first(self) -> QueuedMotion:
        """The queued motion that the servo is on."""
        return self._queued_motions[0]

    @property
    def last(self) -> QueuedMotion:
        """The queued motion after which nothing is planned yet."""
        return self._queued_motions[-1]

    def queued(self, number: int) -> QueuedMotion | None:
        """Return the queued motion of motion *number*, if it has not ended."""
        return next((queued for queued in self._queued_motions if queued.number == number), None)

    def ahead(self, cycle: Cycle, records: int) -> SplicePoint:
        """Return where the servo will be *records* after *cycle*.

        Raises:
            LateError: all motions have ended meanwhile.
        """
        queued_motions = self._queued_motions[:]
        if not queued_motions:
            raise LateError("what ran has ended")
        place = next((k for k, s in enumerate(queued_motions) if s.number == cycle.motion), 0)
        queued = queued_motions[place]
        here = 0
        if queued.number == cycle.motion and queued.feeder is not None:
            here = max(0, cycle.path_index - queued.feeder.first_index)
        while here + records > queued.last_record and place + 1 < len(queued_motions):
            if not queued_motions[place + 1].is_running:
                break  # not in the ring: the servo cannot leave it yet
            records -= max(0, queued.last_record - here)
            place, here = place + 1, 0
            queued = queued_motions[place]
        record = min(here + records, queued.last_record)
        return SplicePoint(queued.number, record)

    def end(self, record: int) -> SplicePoint:
        """Return the last queued motion at *record*.

        Raises:
            StateError: it is not to be run to its end.
        """
        if self.last.withdrawn:
            raise StateError(
                f"motion {self.last.number}, which this was to follow, ends early: "
                f"{self.last.withdrawn}"
            )
        return SplicePoint(self.last.number, record)

    def figures(self, number: int) -> tuple[pb.MotionStatistics | None, int | None]:
        """Return what was measured of motion *number*, and when it began to move, monotonic clock.

        Either is ``None`` where it is not known.
        """
        meter = self._meters.get(number)
        if meter is None:
            return self._measured.get(number, (None, None))
        return meter.statistics(), meter.began_ns

    # Motions

    def begin(self, motion: PlannedMotion, number: int, *, speed: float, start_ns: int) -> None:
        """Start *motion* on a device that holds.

        Raises:
            StateError: the servo does not take it.
            DaemonError: the servo does not answer.
        """
        link, queued = self._link, QueuedMotion(motion, number)
        feeder = queued.feeder = self._feeder(queued)
        feeder.clear()
        self._feed_first(feeder)
        self._metered = link.memory.cycles.head
        self._command(Command.START, queued, feeder, speed=speed, start_ns=start_ns)
        self._queued_motions = [queued]
        self._add_meter(queued, feeder, after=None)

    def replace(self, motion: PlannedMotion, number: int, leave: SplicePoint) -> list[QueuedMotion]:
        """Have *motion* replace everything after *leave*; return the motions that are dropped.

        Raises:
            LateError: the servo has passed that record, or moves no more.
            DaemonError: the servo does not answer.
        """
        left = self.queued(leave.number)
        if left is None or left.feeder is None:
            raise LateError(f"motion {leave.number} has ended")
        queued = QueuedMotion(motion, number)
        self._splice(queued, left, leave.record)
        place = self._queued_motions.index(left)
        dropped = self._queued_motions[place + 1 :]
        left.leave, left.is_replaced = leave.record, True
        left.feeder.leave_at(leave.record)
        self._queued_motions[place + 1 :] = [queued]
        self._let_go(dropped)
        return dropped

    def append(self, motion: PlannedMotion, number: int, leave: SplicePoint) -> None:
        """Have *motion* follow the last queued motion, from *leave* on.

        The servo is told of it at once where the one before is in the ring.

        Raises:
            LateError: the last queued motion is another one by now, or the servo has passed
                *leave* or cannot go over to another one at this moment.
        """
        if (
            not self._queued_motions
            or self.last.number != leave.number
            or self.last.leave is not None
        ):
            raise LateError(f"motion {leave.number} is not the last one any more")
        left = self.last
        left.leave = leave.record
        self._queued_motions.append(QueuedMotion(motion, number))
        try:
            self.feed()
        except StateError as error:
            if isinstance(error, LateError) and leave.record == left.motion.last_record:
                return  # it begins when the one before has come to rest
            self._take_out(len(self._queued_motions) - 1)
            raise
        except DaemonError:
            return  # a servo that does not answer is found out by the next look

    def feed(self) -> None:
        """Fill the ring, and tell the servo of the next motion once it is in there.

        Raises:
            LateError: the servo has passed the record where the next motion begins, or moves no
                more.
            DaemonError: the servo does not answer.
        """
        left: QueuedMotion | None = None
        for queued in self._queued_motions:
            if left is not None and queued.feeder is None:
                self._follow(queued, left)
            feeder, last = queued.feeder, queued.last_record
            if feeder is None:
                return
            while not feeder.has(last) and feeder.feed(BLOCK) == BLOCK:
                self._link.beat()
            if not feeder.has(last):
                return
            left = queued

    def _follow(self, queued: QueuedMotion, left: QueuedMotion) -> None:
        """Have *queued* follow *left*; until the servo takes that up, *left* goes on in the ring.

        Raises:
            LateError: the servo has passed the record where *left* is left, or moves no more.
        """
        try:
            self._splice(queued, left, left.last_record)
        except NotYetError:
            # A stop must fit meanwhile, which may end beyond the record where it is left.
            ring = self._link.memory.path
            fed = ring.head - ring.words[TAIL_WORD]
            if left.feeder is not None and fed < self.needed(left.motion.facts):
                left.feeder.feed(BLOCK)
            raise
        if left.feeder is not None:
            left.feeder.leave_at(left.last_record)

    def miss(self) -> list[QueuedMotion]:
        """Take out what the servo could not be told of in time, unless it follows at rest."""
        place = next(k for k, queued in enumerate(self._queued_motions) if not queued.is_running)
        left = self._queued_motions[place - 1]
        if left.leave == left.motion.last_record:
            return []  # it begins when the one before has come to rest
        return self._take_out(place)

    def withdraw(self, number: int, reason: str) -> list[QueuedMotion] | None:
        """Take out motion *number*, which waits for its turn, and what follows it.

        One that the servo has heard of is left, to be stopped once the one before is behind.

        Returns:
            What was taken out; ``None`` where it is that motion's turn already, or it has ended.
        """
        place = next((k for k, s in enumerate(self._queued_motions) if s.number == number), 0)
        if not place:
            return None
        if self._queued_motions[place].is_running:
            for queued in self._queued_motions[place:]:
                queued.withdrawn = reason
            return []
        return self._take_out(place)

    def _take_out(self, place: int) -> list[QueuedMotion]:
        """Take out the motions from *place* on, so that the one before runs to its end."""
        left = self._queued_motions[place - 1]
        out, self._queued_motions = self._queued_motions[place:], self._queued_motions[:place]
        self._let_go(out)
        left.leave = None
        if left.feeder is not None:
            left.feeder.leave_at(left.motion.last_record)
        return out

    def resume(self, queued_motions: list[QueuedMotion], *, speed: float) -> None:
        """Begin with the first of *queued_motions* on a device at rest; others follow it.

        Raises:
            StateError: the servo does not take it.
        """
        first, *following = queued_motions
        leave = first.leave
        self.begin(first.motion, first.number, speed=speed, start_ns=UNKNOWN)
        if following:
            self._queued_motions[0].leave = leave
            self._queued_motions += following

    def measure_some(self) -> None:
        """Add the cycles since the last look to the measurements, if they have become many."""
        ring = self._link.memory.cycles
        if ring.head - self._metered >= min(_METER_BLOCK, ring.capacity // 4):
            self.measure()

    def measure(self) -> None:
        """Add the cycles since the last look to the measurements."""
        while records := self._link.cycle_records(self._metered, _METER_BLOCK):
            for queued in self._queued_motions:
                meter = self._meters.get(queued.number)
                if meter is not None:
                    meter.add(records)
            self._metered = record_index(records[-1]) + 1

    def passed(self, cycle: Cycle) -> list[QueuedMotion]:
        """Take out the motions that the servo has left behind by *cycle*, and return them."""
        place = next((k for k, s in enumerate(self._queued_motions) if s.number == cycle.motion), 0)
        if place:
            self.measure()
        passed, self._queued_motions = self._queued_motions[:place], self._queued_motions[place:]
        self._let_go(passed)
        if self.first.withdrawn and cycle.state is ServoState.STREAMING:
            self._link.stop()
        return passed

    def clear(self) -> list[QueuedMotion]:
        """Take out all queued motions, and return them."""
        if self._queued_motions:
            self.measure()
        queued_motions, self._queued_motions = self._queued_motions, []
        self._let_go(queued_motions)
        return queued_motions

    # How

    def _let_go(self, queued_motions: list[QueuedMotion]) -> None:
        """Keep of motions that have ended what was measured of them, and nothing else."""
        for queued in queued_motions:
            meter = self._meters.pop(queued.number, None)
            if meter is not None:
                self._measured[queued.number] = meter.statistics(), meter.began_ns
        while len(self._measured) > MEASURED:
            self._measured.popitem(last=False)

    def _splice(self, queued: QueuedMotion, left: QueuedMotion, record: int) -> None:
        """Put the beginning of *queued* into the ring and have the servo go over to it."""
        ring = self._link.memory.path
        head = ring.head
        feeder = queued.feeder = self._feeder(queued)
        first = left.feeder.first_index if left.feeder is not None else 0
        try:
            self._feed_first(feeder)
            self._command(Command.SPLICE, queued, feeder, leave_index=first + record)
        except OrientdError as error:
            # Nobody has heard of these records; what is fed next goes where they are.
            ring.advance(head)
            queued.feeder = None
            if isinstance(error, LateError | DaemonError):
                raise
            raise LateError(str(error)) from error
        self._add_meter(queued, feeder, after=self._meters.get(left.number))

    def _feeder(self, queued: QueuedMotion) -> Feeder:
        ring, usual = self._link.memory.path, self._read_ahead
        # Half of it bridges the daemon's own stalls, whatever a stop takes.
        needed = self.needed(queued.motion.facts) + usual // 2
        ahead = min(max(usual, needed), ring.capacity - MARGIN)
        return Feeder(ring, queued.motion, read_ahead=ahead)

    def needed(self, facts: MotionFacts) -> int:
        """Return how many records of a motion the servo wants to see before it begins."""
        rates = [
            queued.motion.facts.brake_rate for queued in self._queued_motions if queued.is_running
        ]
        slowest = min([*rates, facts.brake_rate])
        return int((1.0 / slowest + _FEED_TIME) / facts.period) + 1

    def _feed_first(self, feeder: Feeder) -> None:
        """Put as much into the ring as the servo wants to see before it begins.

        Until what ran before is behind, the slowest stop of them all must fit.

        Raises:
            NotYetError: the ring has no room for so much.
        """
        needed = self.needed(feeder.motion.facts)
        ring = self._link.memory.path
        while not feeder.is_done and ring.head - feeder.first_index < needed:
            if not feeder.feed(min(BLOCK, needed), is_urgent=True):
                raise NotYetError("motions replaced before they began fill the path ring")

    def _command(
        self,
        command: Command,
        queued: QueuedMotion,
        feeder: Feeder,
        *,
        speed: float = 0.0,
        start_ns: int = UNKNOWN,
        leave_index: int = UNKNOWN,
    ) -> None:
        facts = queued.motion.facts
        self._link.beat()
        self._link.ask(
            command,
            motion=queued.number,
            path_index=feeder.first_index,
            leave_index=leave_index,
            final_index=feeder.final_index if feeder.is_whole else UNKNOWN,
            start_ns=start_ns,
            speed=speed,
            servo_limits=servo_limits_of(facts.limits, facts.brake_rate),
        )
        queued.is_running = True
        feeder.take_up()

    def _add_meter(
        self, queued: QueuedMotion, feeder: Feeder, *, after: MotionMeter | None
    ) -> None:
        self._meters[queued.number] = MotionMeter(
            queued.motion, queued.number, feeder.first_index, lead=self._lead, after=after
        )
