"""Warnings of requests that a server denies, few enough to read: a program repeats its mistake."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

_MOST = 5
"""Most warnings in a second."""


class Denials:
    """Warnings of denied requests; may be called by several threads."""

    def __init__(self, warn: Callable[[str], None]) -> None:
        """Begin without a warning.

        Args:
            warn: takes each warning, one line.
        """
        self._warn, self._last = warn, ""
        self._times: deque[float] = deque(maxlen=_MOST)
        self._lock = threading.Lock()

    def __call__(self, problem: str) -> None:
        """Warn of a problem, unless it is the last one again, or one of many in a second."""
        with self._lock:
            now = time.monotonic()
            is_flood = len(self._times) == _MOST and now < self._times[0] + 1.0
            if problem == self._last or is_flood:
                return
            self._last = problem
            self._times.append(now)
        self._warn(problem)
