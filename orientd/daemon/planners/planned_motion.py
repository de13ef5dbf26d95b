"""A planned motion as the daemon has it: facts, records, and the job to ask for more of them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future

import numpy as np

from orientd.daemon.planners.jobs import CHUNK, Job, Planned
from orientd.errors import OrientdError
from orientd.planner.recorded import RecordedMotion
from orientd.rotation import Floats

_EVENT_WAIT = 1.0
"""How long the journal waits for what it is to tell of a motion, s."""

_BEHIND = 4096
"""Records kept behind those that were fed last: what is sent is compared with them."""

Fetch = Callable[[int, int], "Future[Floats]"]
"""Asks for records from the first one on, so many; from any thread."""


class PlannedMotion(RecordedMotion):
    """A motion of which a planner has worked out the first records.

    Records are fed from the beginning to the end: when those at hand are half used up the next are
    asked for, and old ones are forgotten.

    Attributes:
        job: what it was planned by; any planner makes the same of it again.
        plan: a serialised ``orientd.v1.Plan``.
        response: a serialised ``PlanResponse`` with samples, where these were asked for.
        leave: record of the motion before at which it begins, of one that follows another.
    """

    def __init__(
        self, planned: Planned, job: Job, rows: Floats, *, fetch: Fetch, event: Future[bytes]
    ) -> None:
        """Take what a planner has answered.

        Args:
            planned: what there is to know.
            job: what was asked for.
            rows: the first records.
            fetch: asks for more of them.
            event: what the journal tells of the motion, as soon as that is there.
        """
        super().__init__(planned.facts, rows)
        self.job, self.leave = job, planned.leave
        self.plan, self.response = planned.plan, planned.response
        self._fetch, self._event = fetch, event
        self._coming: Future[Floats] | None = None
        self._lock = threading.Lock()

    @property
    def id(self) -> str:
        """Its name."""
        return self.facts.id

    @property
    def event(self) -> bytes:
        """A serialised ``Event`` with plan, request and samples; empty if there is none in time."""
        try:
            return self._event.result(_EVENT_WAIT)
        except (TimeoutError, CancelledError):
            return b""

    def records(self, first: int, count: int) -> Floats:
        """See :meth:`.RecordedMotion.records`; asks for more where there will soon be none."""
        self._look_ahead(first)
        return super().records(first, count)

    def add(self, rows: Floats) -> None:
        """Take the records that follow those at hand, and forget those that are far behind."""
        with self._lock:
            begin, end = self.at_hand
            kept = max(begin, end - CHUNK // 2 - _BEHIND)
            self._first, self._rows = kept, np.concatenate([self._rows[kept - begin :], rows])

    def _look_ahead(self, first: int) -> None:
        """Ask for more where what is at hand does not last for long."""
        coming = self._coming
        if coming is not None and coming.done():
            self._coming = None
            try:
                self.add(coming.result())
            except OrientdError:
                coming = None  # asked for again below
        end = self.at_hand[1]
        if self._coming is None and end <= self.last_record and first > end - CHUNK // 2:
            self._coming = self._fetch(end, CHUNK)
