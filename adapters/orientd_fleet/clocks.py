"""Estimate the offset of another machine's monotonic clock from ours, and its error bound.

A daemon reads its clock at some instant between our request and its answer.  Its offset therefore
lies in an interval as long as the round trip (Cristian, 1989).  Clock drift widens older intervals.
The offset lies in the intersection of many such intervals, which gives the bound (Marzullo, 1984).
Within it the estimate is the mean of the shortest trips, because their two delays differ least.
"""

from __future__ import annotations

import functools
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

KEPT = 256
"""Round trips that are remembered."""

DRIFT = 5e-4
"""The most by which two clocks run apart, s per s: as much as the kernel ever slews one."""

BURST = 40
"""Round trips of one measurement."""

SPACING = 0.005
"""How long an answer is waited for before the next question is sent, s: a slow link is not idle."""

SHORTEST = 4
"""One trip in so many, the shortest, counts for the estimate."""

PATIENCE = 1.0
"""How long the last answers are waited for, s."""

Ask = Callable[[Callable[[int], None]], object]
"""Asks for the other clock's reading, ns, and hands it to a function once it is here."""


@dataclass(frozen=True, slots=True)
class Offset:
    """How far another clock is ahead of ours.

    Attributes:
        ns: by how much.
        bound_ns: how far that may be wrong, either way.
    """

    ns: int
    bound_ns: int


@dataclass(frozen=True, slots=True)
class _Trip:
    asked_ns: int
    answered_ns: int
    there_ns: int

    def offset(self, at_ns: int) -> Offset:
        """Return the offset by this trip, as loose as it is at another time."""
        middle = (self.asked_ns + self.answered_ns) // 2
        bound = (self.answered_ns - self.asked_ns + 1) // 2
        return Offset(self.there_ns - middle, bound + round(abs(at_ns - middle) * DRIFT))


class ClockOffset:
    """The offset of one other clock, from round trips.  Safe to call from any thread."""

    def __init__(self, ask: Ask, *, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Know of no trip yet.

        Args:
            ask: asks for the other clock.
            now_ns: our clock.
        """
        self._ask, self._now_ns = ask, now_ns
        self._lock = threading.Lock()
        self._trips: deque[_Trip] = deque(maxlen=KEPT)

    def measure(self, trips: int = BURST) -> Offset | None:
        """Make some round trips; return the offset now, ``None`` if no answer ever came."""
        heard = [threading.Event() for _ in range(trips)]
        for is_heard in heard:
            self._ask(functools.partial(self._hear, self._now_ns(), is_heard))
            is_heard.wait(SPACING)
        end = time.monotonic() + PATIENCE
        for is_heard in heard:
            is_heard.wait(max(0.0, end - time.monotonic()))
        return self.at(self._now_ns())

    def _hear(self, asked_ns: int, is_heard: threading.Event, there_ns: int) -> None:
        answered_ns = self._now_ns()
        with self._lock:
            self._trips.append(_Trip(asked_ns, answered_ns, there_ns))
        is_heard.set()

    @property
    def round_trip_ns(self) -> int:
        """How long a round trip takes, all but the slowest of the last; 0 before the first."""
        with self._lock:
            last = sorted(trip.answered_ns - trip.asked_ns for trip in list(self._trips)[-BURST:])
        return last[len(last) * 9 // 10] if last else 0

    def at(self, time_ns: int) -> Offset | None:
        """Return the offset at a time of our clock; ``None`` before the first trip."""
        with self._lock:
            offsets = [trip.offset(time_ns) for trip in self._trips]
        if not offsets:
            return None
        offsets.sort(key=lambda offset: offset.bound_ns)
        low = max(offset.ns - offset.bound_ns for offset in offsets)
        high = min(offset.ns + offset.bound_ns for offset in offsets)
        if low > high:  # of a machine that was suspended, or a clock that ran faster than any may
            return offsets[0]
        shortest = offsets[: max(1, len(offsets) // SHORTEST)]
        mean = sum(offset.ns for offset in shortest) // len(shortest)
        ns = min(max(mean, low), high)
        return Offset(ns, max(ns - low, high - ns))
