"""A motion of a device, from the moment it is asked for to its end."""

from __future__ import annotations

import time
from concurrent.futures import Future
from dataclasses import dataclass, field

from orientd.daemon.device.feeder import Feeder
from orientd.daemon.device.meter import NANOSECONDS, MotionMeter
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.errors import RequestError
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import UNKNOWN, Cycle

Ended = tuple[pb.Outcome, str]
"""How a motion has ended, and why."""


@dataclass(frozen=True, slots=True)
class ArrivalCondition:
    """Define when a motion has arrived, by measurements rather than setpoints.

    Attributes:
        tolerance: largest angle to the target, rad.
        rate: largest angular velocity, rad/s.
        settle_time: how long both must hold without a break, s.
        timeout: how long to wait for that after the last setpoint, s.

    Raises:
        RequestError: one of them is not a positive number.
    """

    tolerance: float
    rate: float
    settle_time: float
    timeout: float

    def __post_init__(self) -> None:
        for name in ("tolerance", "rate", "settle_time", "timeout"):
            number = getattr(self, name)
            if not 0.0 < number < float("inf"):
                raise RequestError(f"on_target.{name}", f"expected more than 0, got {number!r}")


@dataclass(frozen=True, slots=True)
class MoveOptions:
    """How a motion is to begin and to end.

    Attributes:
        is_queued: whether it follows what runs; otherwise it replaces that.
        blend: largest angle from the corner to the motion before, rad; 0 passes the corner itself.
        start_ns: start time, monotonic clock; :data:`~orientd.stream.records.UNKNOWN` for at once.
        gate: when it has arrived; ``None`` for when its last setpoint is sent.
    """

    is_queued: bool = False
    blend: float = 0.0
    start_ns: int = UNKNOWN
    gate: ArrivalCondition | None = None


AT_ONCE = MoveOptions()


@dataclass(frozen=True, slots=True)
class SplicePoint:
    """Where a motion leaves the one before it.

    Attributes:
        number: of the motion that is left.
        record: at which.
    """

    number: int
    record: int


@dataclass(eq=False)
class QueuedMotion:
    """One motion of one device.

    Attributes:
        planned: its plan; ``None`` before there is one, and if the device follows targets.
        options: how it is to begin and to end.
        token: the lease that it was asked for with.
        number: of the motion, 1 for the first of the device; 0 before it begins.
        begins: where it leaves the motion before it; ``None`` if it begins at rest.
        attempts: how often it was planned because the device had passed that point.
        planned_ns, begun_ns: when it was planned, and when the servo had it; monotonic clock.
        leave: record at which the next queued motion begins; ``None`` for the last one.
        is_replaced: whether the next one replaces the rest of it, rather than follows.
        first_index: the path ring's index of its first record; ``None`` before its turn.
        feeder: puts it into the ring; ``None`` before its turn and after its end.
        is_running: whether the servo knows of it.
        meter: has measured it since it began to run; ``None`` before.
        reason: why a client stopped it or its device; empty if none did.
        ended: how it ended and why, once it has.
        reached: how far along it the device was when last seen on it, s.
        settled_after: how long after its last setpoint it was on target, s, if that is known.
    """

    planned: PlannedMotion | None = None
    options: MoveOptions = AT_ONCE
    token: str = ""
    number: int = 0
    begins: SplicePoint | None = None
    attempts: int = 0
    planned_ns: int = 0
    begun_ns: int = 0
    leave: int | None = None
    is_replaced: bool = False
    first_index: int | None = None
    feeder: Feeder | None = None
    is_running: bool = False
    meter: MotionMeter | None = None
    reason: str = ""
    ended: Future[Ended] = field(default_factory=Future)
    reached: float = 0.0
    settled_after: float | None = None

    @property
    def motion(self) -> PlannedMotion:
        """The planned motion; ``ValueError`` if there is none yet."""
        if self.planned is None:
            raise ValueError("the motion is not planned")
        return self.planned

    @property
    def last_record(self) -> int:
        """The record at which it ends, or at which the next motion begins."""
        return self.motion.last_record if self.leave is None else self.leave

    @property
    def final_index(self) -> int:
        """The path ring's index of its last record."""
        return (self.first_index or 0) + self.motion.last_record

    @property
    def statistics(self) -> pb.MotionStatistics | None:
        """Its measured statistics; ``None`` before it begins."""
        return None if self.meter is None else self.meter.statistics()

    @property
    def began_ns(self) -> int | None:
        """When it began to move, monotonic clock; ``None`` if that is not known."""
        return None if self.meter is None else self.meter.began_ns

    def is_waiting(self, seconds: float = 0.0) -> bool:
        """Return whether it will still wait for its start time after a number of seconds."""
        return self.options.start_ns > time.monotonic_ns() + round(seconds * NANOSECONDS)

    def path_time(self, cycle: Cycle) -> float:
        """Return the time within the motion at a cycle of it, s."""
        if self.first_index is None:
            return 0.0
        facts = self.motion.facts
        records = cycle.path_index - self.first_index + cycle.path_fraction
        # The last record may lie up to a period beyond the motion's end.
        return min(max(0.0, records * facts.period), facts.duration)

    def let_go(self) -> None:
        """Note that it has ended: it is fed no more, and measured up to here."""
        self.feeder, self.is_running = None, False
        if self.meter is not None:
            self.meter.end()
