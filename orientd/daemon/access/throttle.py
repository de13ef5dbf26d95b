"""How much one connection may ask for: a bucket that fills at a rate, and calls at one time."""

from __future__ import annotations

from collections import Counter
from weakref import WeakKeyDictionary

BURST = 2.0
"""Seconds' worth of requests that may come at once."""


class Throttle:
    """Count what everybody asks for."""

    def __init__(self, *, per_second: int, at_once: int) -> None:
        """Count nothing yet.

        Args:
            per_second: requests of one connection, over time.
            at_once: calls of one identity at the same time.
        """
        self.per_second = per_second
        self.at_once = at_once
        self._levels: WeakKeyDictionary[object, tuple[float, float]] = WeakKeyDictionary()
        self._calls: Counter[str] = Counter()

    def takes(self, connection: object, now: float) -> bool:
        """Take one request of *connection* at *now*, s; say whether that was not too many."""
        burst = BURST * self.per_second
        level, before = self._levels.get(connection, (burst, now))
        level = min(burst, level + (now - before) * self.per_second)
        is_taken = level >= 1.0
        self._levels[connection] = (level - is_taken, now)
        return is_taken

    def begins(self, key: str) -> bool:
        """Count a call of the identity *key*; say whether it may have one more."""
        if self._calls[key] >= self.at_once:
            return False
        self._calls[key] += 1
        return True

    def ends(self, key: str) -> None:
        """Count one call of *key* less."""
        self._calls[key] -= 1
        if self._calls[key] <= 0:
            del self._calls[key]
