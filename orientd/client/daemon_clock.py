"""The daemon's monotonic clock, as a client on any machine reads it.

A client stamps targets and poses with its own monotonic clock, and the daemon counts on its own.
Both are one clock if the two processes run on one machine.  They know it by its name, which the
daemon sends (:func:`orientd.clock.clock_name`).  Otherwise the client measures the offset.

The daemon reads its clock between the client's question and its answer, so the offset lies in an
interval as long as the round trip (Cristian, 1989).  Clock drift widens older intervals.  The
offset lies in the intersection of the intervals of many trips (Marzullo, 1984).  Its ends are
those of the quickest question and of the quickest answer, and the estimate is its middle.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from orientd.clock import clock_name
from orientd.errors import OrientdError

TRIPS = 10
"""Round trips of a measurement."""

DRIFT = 5e-4
"""The most by which two clocks run apart, s per s: as much as the kernel ever slews one."""

RENEWAL = 60.0
"""Age from which a measurement is repeated, s: clocks of two machines run apart."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The daemon's clock, as one answer had it.

    Attributes:
        ns: the reading.
        name: of that clock; empty if not known.
    """

    ns: int
    name: str


@dataclass(frozen=True, slots=True)
class Offset:
    """How far another monotonic clock, as the daemon's, is ahead of that of this process.

    Attributes:
        ns: by how much.
        bound_ns: how far that may have been wrong when it was measured, either way; 0 on one
            machine.
    """

    ns: int
    bound_ns: int


@dataclass(frozen=True, slots=True)
class Trip:
    """A question for another clock, and its answer.

    Attributes:
        asked_ns: when it was asked, by our clock.
        there_ns: the reading of the other clock.
        answered_ns: when the answer arrived, by our clock.
    """

    asked_ns: int
    there_ns: int
    answered_ns: int

    def offset(self, at_ns: int) -> Offset:
        """Return the offset by this trip, as loose as it is at another time of our clock."""
        middle = (self.asked_ns + self.answered_ns) // 2
        bound = (self.answered_ns - self.asked_ns + 1) // 2
        return Offset(self.there_ns - middle, bound + round(abs(at_ns - middle) * DRIFT))


def clock_offset(trips: Iterable[Trip], at_ns: int) -> Offset:
    """Return the offset of another clock at a time of ours.

    Args:
        trips: round trips, at least one.
        at_ns: the time, by our clock.
    """
    offsets = [trip.offset(at_ns) for trip in trips]
    low = max(offset.ns - offset.bound_ns for offset in offsets)
    high = min(offset.ns + offset.bound_ns for offset in offsets)
    if low > high:  # of a machine that was suspended, or a clock that ran faster than any may
        return min(offsets, key=lambda offset: offset.bound_ns)
    return Offset((low + high) // 2, (high - low + 1) // 2)


class DaemonClock:
    """The offset of the daemon's clock; safe to use from any thread."""

    def __init__(self, ask: Callable[[], Reading], *, is_local: bool) -> None:
        """Know nothing yet.

        Args:
            ask: asks the daemon for its clock.
            is_local: whether the daemon is on this machine if the names of the clocks do not tell.
        """
        self._ask, self._is_local = ask, is_local
        self._lock = threading.Lock()
        self._offset: Offset | None = None
        self._measured = 0.0

    def offset(self) -> Offset:
        """Return the offset; measure it if it is not known, or if that was :data:`RENEWAL` ago.

        If the daemon does not answer a second measurement, the first one counts for as long again.

        Raises:
            OrientdError: the daemon does not answer the first measurement.
        """
        with self._lock:
            known = self._offset
            is_due = time.monotonic() - self._measured > RENEWAL
            if known is not None and (not known.bound_ns or not is_due):
                return known
            self._measured = time.monotonic()
            try:
                self._offset = known = self._measure()
            except OrientdError:
                if known is None:
                    raise
            return known

    def _measure(self) -> Offset:
        trips = []
        for _ in range(TRIPS):
            asked_ns = time.monotonic_ns()
            there = self._ask()
            trips.append(Trip(asked_ns, there.ns, time.monotonic_ns()))
            if self._is_ours(there.name) and asked_ns <= there.ns <= trips[-1].answered_ns:
                return Offset(0, 0)
        return clock_offset(trips, trips[-1].answered_ns)

    def _is_ours(self, name: str) -> bool:
        """Return whether the daemon's clock of this *name* is that of this process."""
        ours = clock_name()
        return name == ours if name and ours else self._is_local
