"""A motion in the queue of a device, and where one motion leaves another."""

from __future__ import annotations

from dataclasses import dataclass

from orientd.daemon.motions.feeder import Feeder
from orientd.daemon.planners import PlannedMotion


@dataclass(eq=False)
class QueuedMotion:
    """One motion of a queue.

    Attributes:
        motion: what is run.
        number: of the motion.
        is_replaced: whether the next queued motion replaces the rest of it, rather than follows.
        leave: record of this motion at which the next queued motion begins; ``None`` for the last
        queued motion.
        feeder: puts it into the ring; ``None`` until its turn has come.
        is_running: whether the servo knows of it.
        withdrawn: why it is to be stopped once its turn has come; empty for one that is to run.
    """

    motion: PlannedMotion
    number: int
    is_replaced: bool = False
    leave: int | None = None
    feeder: Feeder | None = None
    is_running: bool = False
    withdrawn: str = ""

    @property
    def last_record(self) -> int:
        """The record at which the queued motion ends."""
        return self.motion.last_record if self.leave is None else self.leave


@dataclass(frozen=True, slots=True)
class SplicePoint:
    """Where a motion leaves the one before it.

    Attributes:
        number: of the motion that is left.
        record: at which.
    """

    number: int
    record: int
