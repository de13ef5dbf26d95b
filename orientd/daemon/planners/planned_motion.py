"""A planned motion as the daemon has it: facts, records as bytes, and the request for more."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, wait
from typing import Self

from orientd.daemon.planners.messages import CHUNK, Planned, PlanRequest, RecordFile, Rest
from orientd.errors import OrientdError
from orientd.planner.facts import HISTORY
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import embedded, field_number

_WAIT = 1.0
"""Longest wait of the journal for the planner's samples of a motion, s."""

_LOOK = 0.01
"""Seconds from one look for something urgent to the next."""

_BEHIND = 4096
"""Records kept behind those that were fed last: the meter compares the device with them."""

_TAIL = 16_384
"""Most records before the end of a motion at which the next motion may leave it."""

_PLAN, _MOTION, _COLUMNS = (field_number(pb.Event, name) for name in ("plan", "motion", "columns"))

More = Callable[[PlanRequest, RecordFile, int, float], "Future[int]"]
"""Has a planner add records to a file, from one on; returns the end.  From any thread.

The last argument says for how long the records before that one last, s.
"""


class PlannedMotion:
    """A motion of which a planner has worked out the first records.

    Records are fed from the beginning to the end.  When half of those at hand are used up the next
    are asked for, and old ones are forgotten, but for the first chunk.

    Attributes:
        facts: what there is to know of it besides its records.
        request: what it was planned from; any planner makes the same of it again.
        plan: a serialised ``orientd.v1.Plan``.
        samples: a serialised ``Plan`` with samples alone, if the caller asked for some.
        leave: record of the motion before at which it begins, of one that follows another.
        frame: in which it was asked for; ``None`` for the device's own coordinates.
    """

    def __init__(
        self,
        planned: Planned,
        request: PlanRequest,
        file: RecordFile,
        *,
        more: More,
        rest: Future[Rest],
    ) -> None:
        """Take what a planner has answered.

        Args:
            planned: the answer.
            request: what it was asked.
            file: holds the first records.
            more: asks for more of them.
            rest: how many there are in the end, and the samples for the event of the start.
        """
        self.facts = planned.facts
        self.request, self.leave, self.frame = request, planned.leave, planned.frame
        self.plan, self.samples = planned.plan, planned.samples
        self._planned, self._file = planned, file
        self._begin, self._end = -HISTORY, planned.end
        self._more, self._rest = more, rest
        self._is_whole = False
        self._coming: Future[int] | None = None

    @property
    def id(self) -> str:
        """Its name."""
        return self.facts.id

    @property
    def last_record(self) -> int:
        """The record at which it ends."""
        return self.facts.record_count - 1

    @property
    def rest_record(self) -> int:
        """The record at which a motion that begins at rest may follow.

        After the last record the same one comes three times more.  By then the device is at rest
        for differences over cycles, too.
        """
        return self.last_record + HISTORY

    @property
    def event(self) -> bytes:
        """A serialised ``Event`` with plan and request, and with samples once there are some."""
        samples = b""
        with contextlib.suppress(TimeoutError, CancelledError):
            samples = self._rest.result(0.0).samples
        asked = pb.Event(source=self.request.source).SerializeToString() + samples
        parts = (_PLAN, self.plan), (_MOTION, self.request.motion), (_COLUMNS, self.request.columns)
        return b"".join(embedded(number, part) for number, part in parts if part) + asked

    def await_event(self, is_urgent: Callable[[], bool]) -> bool:
        """Wait until :attr:`event` has its samples, or will not have them in time.

        Returns:
            ``False`` if something urgent has cut the wait short.
        """
        end = time.monotonic() + _WAIT
        while not self._rest.done() and time.monotonic() < end:
            if is_urgent():
                return False
            wait([self._rest], _LOOK)
        return True

    @property
    def at_hand(self) -> tuple[int, int]:
        """The first record that is at hand, and the one after the last."""
        if not self._is_whole and self._rest.done():
            self._is_whole = True
            if not self._rest.cancelled():
                self._end = max(self._end, self._rest.result().end)
        return self._begin, self._end

    def tail_record(self, earliest: int) -> int:
        """Return the first record from *earliest* on at which a motion that follows may begin."""
        facts = self.facts
        corner = min(
            math.ceil(facts.last_passed / facts.period), int(facts.end_time / facts.period) - 1
        )
        last = self.last_record
        return max(min(earliest, last), min(corner, last), facts.record_count - _TAIL)

    def again(self) -> Self:
        """Return the motion with its first records, to be run from its beginning."""
        return type(self)(self._planned, self.request, self._file, more=self._more, rest=self._rest)

    async def arrive(self, count: int) -> None:
        """Wait until so many records are at hand, or all there are, or no more will come now."""
        if self.at_hand[1] < min(count, self.facts.record_count):
            await asyncio.wait([asyncio.wrap_future(self._rest)])

    def read(self, first: int, count: int) -> bytes:
        """Return records, each a :data:`.MOTION_RECORD`.

        Args:
            first: down to -3: before the first record the device was where it came from.
            count: how many, up to :attr:`rest_record`.

        Raises:
            ValueError: there are no such records, or they are not at hand.
        """
        begin, end = self.at_hand[0], self._readable
        if count < 0 or first < begin or first + count > end:
            raise ValueError(
                f"records must be within {begin} to {end}, got {first} to {first + count}"
            )
        held = max(0, first + count - self.facts.record_count)
        if not held:
            return self._file.read(first, count)
        known = max(0, count - held)
        return self._file.read(first, known) + self._file.read(self.last_record, 1) * (
            count - known
        )

    def feed(self, first: int, count: int) -> bytes:
        """Return as many of *count* records as are at hand; ask for more if few are left."""
        self._look_ahead(first)
        return self.read(first, min(count, self._readable - first))

    @property
    def _readable(self) -> int:
        """The record after the last one that can be read."""
        end = self.at_hand[1]
        return self.rest_record + 1 if end == self.facts.record_count else end

    def start_at(self, record: int) -> bytes:
        """Return a record behind the three before it, for a motion that takes over there.

        Raises:
            ValueError: there is no such record, or it is not at hand.
        """
        return self.read(record - HISTORY, HISTORY + 1)

    def _look_ahead(self, first: int) -> None:
        """Ask for more if the records at hand do not last for long."""
        coming = self._coming
        if coming is not None and coming.done():
            self._coming = None
            # A failure is asked for again below.
            with contextlib.suppress(OrientdError):
                self._end = coming.result()
                self._forget(first - _BEHIND)
        end = self.at_hand[1]
        is_last = not self._is_whole or end > self.last_record
        if self._coming is None and not is_last and first > end - CHUNK // 2:
            lasts = (end - first) * self.facts.period
            self._coming = self._more(self.request, self._file, end, lasts)

    def _forget(self, before: int) -> None:
        """Forget records that are far behind; the first chunk stays for another run."""
        if before > CHUNK:
            begin, self._begin = max(CHUNK, self._begin), before
            self._file.forget(begin, before)
