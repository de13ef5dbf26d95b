"""Time in integer monotonic nanoseconds: the machine's, or one that is moved by hand."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Tells the time."""

    def now_ns(self) -> int:
        """Return the time in nanoseconds; it never decreases."""
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    now_ns = staticmethod(time.monotonic_ns)


class ManualClock:
    """A clock that stands still until it is moved."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the time that it was last moved to."""
        return self._now_ns

    def advance(self, step_ns: int) -> None:
        """Move forward."""
        self._now_ns += step_ns
