"""A planned motion as the daemon has it: facts, records, and the job to ask for more of them."""

from __future__ import annotations

import asyncio
import contextlib
import copy
import math
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import replace
from typing import Self

import numpy as np

from orientd.daemon.planners.jobs import CHUNK, PlanInput, PlannedRecords, RemainingRecords
from orientd.daemon.planners.record_file import Chunk
from orientd.errors import OrientdError
from orientd.planner import RecordedMotion
from orientd.rotation import Floats

_WAIT = 1.0
"""How long the journal waits for what it is to tell of a motion, s."""

_BEHIND = 4096
"""Records kept behind those that were fed last: what is sent is compared with them."""

_TAIL = 16_384
"""Records from the end of a motion, at the most, on which one that follows it may leave it."""

Fetch = Callable[[int, int], "Future[Chunk]"]
"""Asks for records from the first one on, so many; from any thread."""


class PlannedMotion(RecordedMotion):
    """A motion of which a planner has worked out the first records.

    Records are fed from the beginning to the end: when half of those at hand are used up the next
    are asked for, and old ones are forgotten.

    Attributes:
        job: what it was planned by; any planner makes the same of it again.
        plan: a serialised ``orientd.v1.Plan``.
        response: a serialised ``PlanResponse`` with samples, where these were asked for.
        leave: record of the motion before at which it begins, of one that follows another.
        frame: in which it was asked for; ``None`` for the device's own coordinates.
    """

    def __init__(
        self,
        planned: PlannedRecords,
        job: PlanInput,
        chunk: Chunk,
        *,
        fetch: Fetch,
        rest: Future[RemainingRecords],
    ) -> None:
        """Take what a planner has answered.

        Args:
            planned: what there is to know.
            job: what was asked for.
            chunk: the first records.
            fetch: asks for more of them.
            rest: says how many there are in the end, and what the journal tells of the motion.
        """
        super().__init__(planned.facts, np.empty((0, chunk.columns)))
        self.job, self.leave = job, planned.leave
        self.frame = planned.frame
        self.plan, self.response = planned.plan, planned.response
        self._chunks: tuple[Chunk, ...] = (chunk,)
        self._fetch, self._rest = fetch, rest
        self._is_whole = False
        self._coming: Future[Chunk] | None = None

    @property
    def id(self) -> str:
        """Its name."""
        return self.facts.id

    @property
    def event(self) -> bytes:
        """A serialised ``Event`` with plan, request and samples; empty if there is none in time."""
        try:
            return self._rest.result(_WAIT).event
        except (TimeoutError, CancelledError):
            return b""

    @property
    def at_hand(self) -> tuple[int, int]:
        """The first record that is at hand, and the one after the last."""
        if not self._is_whole and self._rest.done():
            self._is_whole = True
            if not self._rest.cancelled():
                whole = replace(self._chunks[0], count=self._rest.result().count)
                self._chunks = (whole, *self._chunks[1:])
        chunks = self._chunks
        return chunks[0].first, chunks[-1].end

    def tail_record(self, earliest: int) -> int:
        """Return the first record from *earliest* on at which a motion that follows may begin."""
        facts = self.facts
        corner = min(
            math.ceil(facts.last_passed / facts.period), round(facts.end_time / facts.period)
        )
        return max(earliest, min(corner, self.last_record), facts.record_count - _TAIL)

    def again(self) -> Self:
        """Return the motion with its first records, to be run from its beginning."""
        return copy.copy(self)

    async def arrive(self, count: int) -> None:
        """Wait until so many records are at hand, or all there are, or no more will come now."""
        if self.at_hand[1] < min(count, self.facts.record_count):
            await asyncio.wait([asyncio.wrap_future(self._rest)])

    def records(self, first: int, count: int) -> Floats:
        """See :meth:`.RecordedMotion.records`; asks for more where there will soon be none."""
        self._look_ahead(first)
        return super().records(first, count)

    def _read(self, first: int, count: int) -> Floats:
        end = first + count
        parts = [
            chunk.read(max(first, chunk.first), min(end, chunk.end) - max(first, chunk.first))
            for chunk in self._chunks
            if chunk.first < end and first < chunk.end
        ]
        return parts[0] if len(parts) == 1 else np.concatenate([self._rows, *parts])

    def _look_ahead(self, first: int) -> None:
        """Ask for more where what is at hand does not last for long."""
        coming = self._coming
        if coming is not None and coming.done():
            self._coming = None
            # If it was not to be had, it is asked for again below.
            with contextlib.suppress(OrientdError):
                self._add(coming.result(), first)
        end = self.at_hand[1]
        is_last = not self._is_whole or end > self.last_record
        if self._coming is None and not is_last and first > end - CHUNK // 2:
            self._coming = self._fetch(end, CHUNK)

    def _add(self, chunk: Chunk, fed: int) -> None:
        """Take the records that follow those at hand, and forget those that are far behind."""
        kept = [one for one in self._chunks if one.end > fed - _BEHIND]
        self._chunks = (*kept, chunk)
