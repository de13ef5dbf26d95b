"""How much callers may ask for: a bucket that fills at a rate, and calls at one time."""

from __future__ import annotations

from collections import Counter
from weakref import WeakKeyDictionary

BURST = 2.0
"""Seconds' worth of requests that may come at once."""

CONNECTIONS = 4
"""How many times as much as over one connection an identity may ask for over all of its."""

RESERVE = 16
"""Calls at the same time beyond the limit, for those made under a lease of the caller's own."""


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
        self._of_all: dict[str, tuple[float, float]] = {}
        self._calls: Counter[str] = Counter()

    def takes(self, connection: object, key: str, now: float, *, has_lease: bool = False) -> bool:
        """Take one request of *connection* at *now*, s; say whether that was not too many.

        Args:
            connection: whose rate is limited.
            key: of the identity, whose rate over all of its connections is limited too.
            now: s.
            has_lease: whether the request is made under a lease of the identity's own: those count
                by themselves, so that no other program of the same user keeps them out.
        """
        key = f"{key} lease" if has_lease else key
        level = self._level(self._levels.get(connection), self.per_second, now)
        of_all = self._level(self._of_all.get(key), CONNECTIONS * self.per_second, now)
        is_taken = level >= 1.0 and of_all >= 1.0
        self._levels[connection] = (level - is_taken, now)
        self._of_all[key] = (of_all - is_taken, now)
        return is_taken

    @staticmethod
    def _level(before: tuple[float, float] | None, per_second: float, now: float) -> float:
        """Return how full a bucket is by *now*, which was at a level at a time."""
        burst = BURST * per_second
        return burst if before is None else min(burst, before[0] + (now - before[1]) * per_second)

    def begins(self, key: str, *, has_lease: bool = False) -> bool:
        """Count a call of the identity *key*; say whether it may have one more."""
        if self._calls[key] >= self.at_once + (RESERVE if has_lease else 0):
            return False
        self._calls[key] += 1
        return True

    def ends(self, key: str) -> None:
        """Count one call of *key* less."""
        self._calls[key] -= 1
        if self._calls[key] <= 0:
            del self._calls[key]
