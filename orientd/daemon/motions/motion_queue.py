"""The motions of one device on their way into its servo: the one that runs, and what follows it.

Every motion is a stage.  The next stage begins where the one before is left: at a record on its
way, where it is replaced or blended into the next, or at its last one.  A stage is fed into the
path ring once the one before has been, as far as it will be; then the servo is told of the splice.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from orientd.daemon.devices import ServoLink, terms_of
from orientd.daemon.motions.feeder import BLOCK, Feeder
from orientd.daemon.motions.meter import MotionMeter, MotionStatistics
from orientd.daemon.planners import PlannedMotion
from orientd.errors import LateError, NotYetError, StateError
from orientd.planner import MotionFacts
from orientd.stream import UNKNOWN, Command, Cycle, record_index

MEASURED = 16
"""Motions that have ended whose measurements are kept."""

_METER_BLOCK = 256
"""Cycles measured at a time: few of them would cost nearly as much as so many."""

_FEED_TIME = 0.25
"""How much of a motion is fed before the servo is told of it, beyond what a stop takes; s."""


@dataclass(eq=False)
class Stage:
    """One motion of an itinerary.

    Attributes:
        motion: what is run.
        number: of the motion.
        is_replaced: whether the next stage replaces the rest of it, rather than follows.
        leave: record of this motion at which the next stage begins; ``None`` for the last stage.
        feeder: puts it into the ring; ``None`` until its turn has come.
        is_running: whether the servo knows of it.
    """

    motion: PlannedMotion
    number: int
    is_replaced: bool = False
    leave: int | None = None
    feeder: Feeder | None = None
    is_running: bool = False

    @property
    def last_record(self) -> int:
        """The record at which the stage ends."""
        return self.motion.last_record if self.leave is None else self.leave


@dataclass(frozen=True, slots=True)
class Leave:
    """Where a motion leaves the one before it.

    Attributes:
        number: of the motion that is left.
        record: at which.
    """

    number: int
    record: int


class Itinerary:
    """The stages of a device, in order; the servo is on one of them or on its way to the first."""

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
        self._stages: list[Stage] = []
        self._meters: dict[int, MotionMeter] = {}
        self._measured: OrderedDict[int, tuple[MotionStatistics, int | None]] = OrderedDict()
        self._metered = 0

    # What there is

    @property
    def is_active(self) -> bool:
        """Whether there is a motion that has not ended."""
        return bool(self._stages)

    @property
    def first(self) -> Stage:
        """The stage that the servo is on."""
        return self._stages[0]

    @property
    def last(self) -> Stage:
        """The stage after which nothing is planned yet."""
        return self._stages[-1]

    def stage(self, number: int) -> Stage | None:
        """Return the stage of motion *number*, if it has not ended."""
        return next((stage for stage in self._stages if stage.number == number), None)

    def ahead(self, cycle: Cycle, records: int) -> Leave:
        """Return where the servo will be *records* after *cycle*."""
        place = next((k for k, s in enumerate(self._stages) if s.number == cycle.motion), 0)
        stage = self._stages[place]
        here = 0
        if stage.number == cycle.motion and stage.feeder is not None:
            here = max(0, cycle.path_index - stage.feeder.first_index)
        while here + records > stage.last_record and place + 1 < len(self._stages):
            if not self._stages[place + 1].is_running:
                break  # not in the ring: the servo cannot leave it yet
            records -= max(0, stage.last_record - here)
            place, here = place + 1, 0
            stage = self._stages[place]
        record = min(here + records, stage.last_record)
        return Leave(stage.number, record)

    def end(self, record: int) -> Leave:
        """Return the last stage at *record*."""
        return Leave(self.last.number, record)

    def statistics(self, number: int) -> MotionStatistics | None:
        """Return what was measured of motion *number*; ``None`` where that is not known."""
        return self._figures(number)[0]

    def began_ns(self, number: int) -> int | None:
        """Return when motion *number* began to move, monotonic clock, where that is known."""
        return self._figures(number)[1]

    def _figures(self, number: int) -> tuple[MotionStatistics | None, int | None]:
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
        link, stage = self._link, Stage(motion, number)
        feeder = stage.feeder = self._feeder(stage)
        feeder.clear()
        self._feed_first(feeder)
        self._metered = link.memory.cycles.head
        self._command(Command.START, stage, speed=speed, start_ns=start_ns)
        self._stages = [stage]
        self._add_meter(stage, after=None)

    def replace(self, motion: PlannedMotion, number: int, leave: Leave) -> list[Stage]:
        """Have *motion* replace everything after *leave*; return the stages that are dropped.

        Raises:
            LateError: the servo has passed that record, or moves no more.
            DaemonError: the servo does not answer.
        """
        left = self.stage(leave.number)
        if left is None or left.feeder is None:
            raise LateError(f"motion {leave.number} has ended")
        stage = Stage(motion, number)
        self._splice(stage, left, leave.record)
        place = self._stages.index(left)
        dropped = self._stages[place + 1 :]
        left.leave, left.is_replaced = leave.record, True
        left.feeder.leave_at(leave.record)
        self._stages[place + 1 :] = [stage]
        self._let_go(dropped)
        return dropped

    def append(self, motion: PlannedMotion, number: int, leave: Leave) -> None:
        """Have *motion* follow the last stage, from *leave* on.

        Raises:
            LateError: the last stage is another one by now.
        """
        if not self._stages or self.last.number != leave.number or self.last.leave is not None:
            raise LateError(f"motion {leave.number} is not the last one any more")
        self.last.leave = leave.record
        if self.last.feeder is not None:
            self.last.feeder.leave_at(leave.record)
        self._stages.append(Stage(motion, number))

    def feed(self) -> None:
        """Fill the ring, and tell the servo of the next motion once it is in there.

        Raises:
            LateError: the servo has passed the record where the next motion begins, or moves no
                more.
            DaemonError: the servo does not answer.
        """
        for place, stage in enumerate(self._stages):
            if stage.feeder is None:
                left = self._stages[place - 1]
                self._splice(stage, left, left.last_record)
            feeder = stage.feeder
            while feeder is not None and not feeder.is_done and feeder.feed(BLOCK) == BLOCK:
                self._link.beat()
            if feeder is None or not feeder.is_done:
                return

    def miss(self) -> list[Stage]:
        """Take out what the servo could not be told of in time, unless it follows at rest."""
        place = next(k for k, stage in enumerate(self._stages) if not stage.is_running)
        left = self._stages[place - 1]
        if left.leave == left.motion.last_record:
            return []  # it begins when the one before has come to rest
        missed, self._stages = self._stages[place:], self._stages[:place]
        self._let_go(missed)
        left.leave = None
        if left.feeder is not None:
            left.feeder.leave_at(left.motion.last_record)
        return missed

    def resume(self, stages: list[Stage], *, speed: float) -> None:
        """Begin with the first of *stages* on a device that has come to rest; others follow it.

        Raises:
            StateError: the servo does not take it.
        """
        first, *following = stages
        leave = first.leave
        self.begin(first.motion, first.number, speed=speed, start_ns=UNKNOWN)
        if following:
            self._stages[0].leave = leave
            self._stages += following

    def measure_some(self) -> None:
        """Add the cycles since the last look to the measurements, if they have become many."""
        ring = self._link.memory.cycles
        if ring.head - self._metered >= min(_METER_BLOCK, ring.capacity // 4):
            self.measure()

    def measure(self) -> None:
        """Add the cycles since the last look to the measurements."""
        while records := self._link.cycle_records(self._metered, _METER_BLOCK):
            for stage in self._stages:
                meter = self._meters.get(stage.number)
                if meter is not None:
                    meter.add(records)
            self._metered = record_index(records[-1]) + 1

    def passed(self, cycle: Cycle) -> list[Stage]:
        """Take out the stages that the servo has left behind by *cycle*, and return them."""
        place = next((k for k, s in enumerate(self._stages) if s.number == cycle.motion), 0)
        if place:
            self.measure()
        passed, self._stages = self._stages[:place], self._stages[place:]
        self._let_go(passed)
        return passed

    def clear(self) -> list[Stage]:
        """Take out all stages, and return them."""
        if self._stages:
            self.measure()
        stages, self._stages = self._stages, []
        self._let_go(stages)
        return stages

    # How

    def _let_go(self, stages: list[Stage]) -> None:
        """Keep of motions that have ended what was measured of them, and nothing else."""
        for stage in stages:
            meter = self._meters.pop(stage.number, None)
            if meter is not None:
                self._measured[stage.number] = meter.statistics(), meter.began_ns
        while len(self._measured) > MEASURED:
            self._measured.popitem(last=False)

    def _splice(self, stage: Stage, left: Stage, record: int) -> None:
        """Put the beginning of *stage* into the ring and have the servo go over to it."""
        ring = self._link.memory.path
        head = ring.head
        stage.feeder = self._feeder(stage)
        first = left.feeder.first_index if left.feeder is not None else 0
        try:
            self._feed_first(stage.feeder)
            self._command(Command.SPLICE, stage, leave_index=first + record)
        except StateError as error:
            # Nobody has heard of these records; what is fed next goes where they are.
            ring.advance(head)
            stage.feeder = None
            raise error if isinstance(error, LateError) else LateError(str(error)) from error
        self._add_meter(stage, after=self._meters.get(left.number))

    def _feeder(self, stage: Stage) -> Feeder:
        feeder = Feeder(self._link.memory.path, stage.motion, read_ahead=self._read_ahead)
        if stage.leave is not None:
            feeder.leave_at(stage.leave)
        return feeder

    def needed(self, facts: MotionFacts) -> int:
        """Return how many records of a motion the servo wants to see before it begins."""
        rates = [stage.motion.facts.brake_rate for stage in self._stages if stage.is_running]
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
        stage: Stage,
        *,
        speed: float = 0.0,
        start_ns: int = UNKNOWN,
        leave_index: int = UNKNOWN,
    ) -> None:
        feeder = stage.feeder
        if feeder is None:
            raise ValueError("the stage has no feeder")
        self._link.beat()
        self._link.ask(
            command,
            motion=stage.number,
            path_index=feeder.first_index,
            leave_index=leave_index,
            final_index=feeder.final_index if feeder.is_whole else UNKNOWN,
            start_ns=start_ns,
            speed=speed,
            terms=terms_of(stage.motion.facts.limits, stage.motion.facts.brake_rate),
        )
        stage.is_running = True
        feeder.take_up()

    def _add_meter(self, stage: Stage, *, after: MotionMeter | None) -> None:
        feeder = stage.feeder
        first = 0 if feeder is None else feeder.first_index
        self._meters[stage.number] = MotionMeter(
            stage.motion, stage.number, first, lead=self._lead, after=after
        )
