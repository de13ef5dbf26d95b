"""What crosses between the daemon and a planner process: questions, answers, and their frames.

A frame is a length and a pickle; both ends are of one installation and one user.  Records do not
go that way: with a question for them comes the descriptor of the file that they are written to.
The first frame to the process that planners are forked from is the list of devices to plan for.
"""

from __future__ import annotations

import os
import pickle
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from orientd import errors
from orientd.errors import OrientdError, PlanError
from orientd.planner import Frame, Joints, Limits, MotionFacts, RecordedMotion, State

CHUNK = 65_536
"""Records that are worked out at a time: two minutes at 500 Hz."""

FIRST = 1024
"""Records that are there with the first answer; the rest of the chunk comes with the second."""

STAGE_BYTES = 256
"""Of memory shared with one planner: what it is at, in words, for whoever gives it up."""

HEADER = struct.Struct("!Q")
PID = struct.Struct("!q")


@dataclass(frozen=True, slots=True)
class PlannerDevice:
    """What a planner is told of a device.

    Attributes:
        name: of the device.
        driver: the registry's name of its driver.
        options: of the driver.
        period_ns: of its cycle.
        limits: what no motion may exceed.
        frames: that motions may name.
    """

    name: str
    driver: str
    options: Mapping[str, Any]
    period_ns: int
    limits: Limits
    frames: Mapping[str, Frame] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Continuation:
    """The motion before one that is to follow it.

    Attributes:
        first: its end.
        tolerance: how far from the corner between the two the device may pass, rad.
        earliest: its record before which it cannot be left any more.
    """

    first: RecordedMotion
    tolerance: float
    earliest: int


@dataclass(frozen=True, slots=True, eq=False)
class PlanInput:
    """A motion to plan, with everything that it depends on.

    Attributes:
        device: what is to move.
        motion: a serialised ``orientd.v1.MotionRequest``.
        motion_id: names the motion, and no other.
        start: where the device will be; not of a continuation.
        joints: its axis angles there, rad.
        before: axis angles planned for the cycles before, where it moves.
        rates: velocities of the axes planned there, rad/s, where it moves.
        after: what it is to follow; ``None`` for what begins at *start*.
    """

    device: str
    motion: bytes
    motion_id: str = field(default_factory=lambda: os.urandom(6).hex())
    start: State | None = None
    joints: Joints = ()
    before: tuple[Joints, ...] = ()
    rates: Joints = ()
    after: Continuation | None = None


@dataclass(frozen=True, slots=True)
class Report:
    """What a caller is to be told of a motion, serialised.

    Attributes:
        rate_hz: samples a second to add; 0 for none.
    """

    rate_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class Records:
    """Records to work out.

    Attributes:
        first: of them.
        count: at the most; fewer where the motion ends.
        rate_hz: samples a second to report with the first of them; 0 for none.
    """

    first: int = 0
    count: int = CHUNK
    rate_hz: float = 0.0

    @property
    def is_first(self) -> bool:
        """Whether few come with the first answer, and a second one follows with the rest."""
        return self.first == 0


@dataclass(frozen=True, slots=True)
class Methods:
    """The families of curves, as a serialised ``ListMethodsResponse``."""


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What a planner is asked.

    Attributes:
        what: is wanted; of a motion, but for the methods.
        job: how that motion is made.
    """

    what: Records | Report | Methods
    job: PlanInput | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PlannedRecords:
    """Of a motion whose records have been written to the file that came with the question.

    Attributes:
        facts: what there is to know of it.
        leave: record of the motion before at which it begins, of a continuation.
        plan: a serialised ``orientd.v1.Plan``; empty behind the first records.
        response: a serialised ``PlanResponse`` with samples, where these were asked for.
        shape: of the records in the file.
        frame: in which the motion was asked for; ``None`` for the device's own coordinates.
    """

    facts: MotionFacts
    leave: int
    plan: bytes
    response: bytes
    shape: tuple[int, int]
    frame: Frame | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RemainingRecords:
    """What follows when nobody waits for it any more.

    Attributes:
        count: records in the file by now.
        event: a serialised ``Event``, with what the journal tells when the motion starts.
    """

    count: int
    event: bytes


@dataclass(frozen=True, slots=True, eq=False)
class PlannerAnswer:
    """What a planner says.

    Attributes:
        content: a message's bytes, what was planned, or what follows; ``None`` where it failed.
        error: why.
        resident: bytes of memory that the process uses now.
    """

    content: bytes | PlannedRecords | RemainingRecords | None = None
    error: Failure | None = None
    resident: int = 0


@dataclass(frozen=True, slots=True)
class Failure:
    """An error on its way to whoever waits for a plan."""

    kind: str
    text: str
    attributes: Mapping[str, Any]

    @classmethod
    def of(cls, error: OrientdError) -> Failure:
        """Take an error apart."""
        return cls(type(error).__name__, str(error), vars(error).copy())

    def error(self) -> OrientdError:
        """Return the error as it was."""
        kind = getattr(errors, self.kind, PlanError)
        found: OrientdError = kind.__new__(kind, self.text)
        found.args = (self.text,)
        vars(found).update(self.attributes)
        return found


def frame(content: object) -> bytes:
    """Return *content* with its length in front."""
    body = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    return HEADER.pack(len(body)) + body


def unframed(body: bytes | bytearray) -> Any:  # noqa: ANN401 - whatever was framed
    """Return what the body of a frame holds."""
    return pickle.loads(body)
