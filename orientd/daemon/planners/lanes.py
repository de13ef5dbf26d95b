"""What waits to be planned: lanes by rank, in which callers take turns.

Lanes keep what is short from waiting behind what is long.  Within a lane callers take turns, so
that one with many requests delays another by no more than one of them; and how much of one caller
may wait is limited.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import OrderedDict, deque
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from enum import IntEnum

from orientd.daemon.planners.jobs import (
    PlannedRecords,
    PlannerAnswer,
    Question,
    Records,
    RemainingRecords,
)
from orientd.daemon.planners.process import PlannerProcess
from orientd.daemon.planners.record_file import RecordFile
from orientd.errors import TooMuchError

MOST_WAITING = 32
"""Requests of one caller that may wait for their turn."""

MOST_WAITING_BYTES = 24 * 2**20
"""Of the requests of one caller that wait."""

MOST_BYTES = 64 * 2**20
"""Of all requests that wait; of each caller one may wait in any case, and small ones."""

SMALL_BYTES = 32_768
"""Of a request that counts as small: some 800 keyframes."""


class Rank(IntEnum):
    """What may wait for what."""

    URGENT = 0
    SMALL = 1
    LARGE = 2


@dataclass(frozen=True, slots=True)
class PlanCall:
    """A motion that somebody asks for.

    Attributes:
        motion: a serialised ``orientd.v1.MotionRequest``.
        caller: who asks; callers take turns.
        timeout: how long planning may take, waiting for a turn and planning anew included, s.
        rate_hz: samples a second to report with the plan; 0 for none.
        began: when that time began, monotonic s.
        waits: s, each that the device was waited for; see :meth:`waiting`.
    """

    motion: bytes
    caller: str = ""
    timeout: float = 10.0
    rate_hz: float = 0.0
    began: float = field(default_factory=time.monotonic)
    waits: list[float] = field(default_factory=list)

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Count what the context takes as time in which the device is waited for."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self.waits.append(time.monotonic() - begun)

    @property
    def time_left(self) -> float:
        """How much of that time is left, s."""
        return max(0.0, self.began + self.timeout - time.monotonic())

    @property
    def rank(self) -> Rank:
        """What it may wait for, on a device at rest."""
        return Rank.SMALL if len(self.motion) <= SMALL_BYTES else Rank.LARGE


@dataclass(eq=False, slots=True)
class Waiting:
    """A question and who waits for the answer."""

    question: Question
    caller: str
    size: int
    answer: asyncio.Future[PlannerAnswer]
    file: RecordFile | None
    rest: Future[RemainingRecords] = field(default_factory=Future)
    process: PlannerProcess | None = None

    @property
    def content(self) -> bytes | PlannedRecords | RemainingRecords | None:
        """What the question was answered with."""
        return self.answer.result().content


@dataclass(slots=True)
class _Lane:
    """What waits in one lane, by caller; the first caller is served next."""

    callers: OrderedDict[str, deque[Waiting]] = field(default_factory=OrderedDict)

    def put(self, waiting: Waiting) -> None:
        self.callers.setdefault(waiting.caller, deque()).append(waiting)

    def take(self) -> Waiting | None:
        while self.callers:
            caller, queue = self.callers.popitem(last=False)
            while queue:
                waiting = queue.popleft()
                if queue:
                    self.callers[caller] = queue
                if not waiting.answer.done():
                    return waiting
        return None

    def all(self) -> list[Waiting]:
        queues = self.callers.values()
        return [one for queue in queues for one in queue if not one.answer.done()]


class Lanes:
    """All that waits, one lane for each rank."""

    def __init__(self) -> None:
        self._lanes = {rank: _Lane() for rank in Rank}

    def enter(self, question: Question, rank: Rank, order: PlanCall) -> Waiting:
        """Have a question wait for its turn; to be called in the event loop.

        Raises:
            TooMuchError: too much of the same caller waits already.
        """
        size = len(order.motion)
        if order.caller:
            self._check(order, size)
        answer = asyncio.get_running_loop().create_future()
        file = RecordFile() if isinstance(question.what, Records) else None
        asked = Waiting(question, order.caller, size, answer, file)
        self._lanes[rank].put(asked)
        return asked

    def _check(self, order: PlanCall, size: int) -> None:
        waiting = [one for lane in self._lanes.values() for one in lane.all()]
        others = [one for one in waiting if one.caller == order.caller]
        is_large = order.rank is Rank.LARGE
        if len(others) >= MOST_WAITING:
            raise TooMuchError(
                f"at most {MOST_WAITING} requests of one caller may wait to be planned"
            )
        if others and sum(one.size for one in others) + size > MOST_WAITING_BYTES:
            raise TooMuchError(
                f"at most {MOST_WAITING_BYTES >> 20} MiB of requests of one caller may wait"
            )
        if others and is_large and sum(one.size for one in waiting) + size > MOST_BYTES:
            raise TooMuchError(
                f"at most {MOST_BYTES >> 20} MiB of requests of all callers may wait"
            )

    def take(self, slowest: Rank = Rank.LARGE) -> Waiting | None:
        """Take out what is to be served next, of a rank up to *slowest*."""
        first = (lane.take() for rank, lane in self._lanes.items() if rank <= slowest)
        return next((waiting for waiting in first if waiting is not None), None)
