"""Measure the offset of another machine's monotonic clock with many questions at once."""

from __future__ import annotations

import functools
import threading
import time
from collections import deque
from collections.abc import Callable

from orientd.client import Offset, Trip, clock_offset

KEPT = 256
"""Round trips that are remembered."""

BURST = 40
"""Round trips of one measurement."""

SPACING = 0.005
"""How long an answer is waited for before the next question is sent, s: a slow link is not idle."""

PATIENCE = 1.0
"""How long the last answers are waited for, s."""

Ask = Callable[[Callable[[int], None]], object]
"""Asks for the other clock's reading, ns, and hands it to a function once it is here."""


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
        self._trips: deque[Trip] = deque(maxlen=KEPT)

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
            self._trips.append(Trip(asked_ns, there_ns, answered_ns))
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
            return clock_offset(self._trips, time_ns) if self._trips else None
