"""Estimate the replanning horizon: how far ahead of the setpoint a new motion takes over.

That is from the moment when the place to take over at is chosen until the servo is handed the
motion, learnt from what plans of the same kind have lately taken.  The second longest of the last
few counts: one that was held up does not make those after it wait.
"""

from __future__ import annotations

from collections import deque

from orientd.daemon.motions.options import Kind

_FIRST = 0.004
"""How long it takes, s, before that has been measured."""

_LONGEST = 0.25
"""As far ahead as that at the most, s, where it has not been too late before."""

_KEPT, _RANK = 12, 2
_SHARE = 1.1


class ReplanningHorizon:
    """What planning and handing over have lately taken, by the kind of plan."""

    def __init__(self) -> None:
        self._taken: dict[Kind, deque[float]] = {}

    def add(self, kind: Kind, seconds: float) -> None:
        """Take note of how long it took from choosing a place to the servo's answer."""
        self._taken.setdefault(kind, deque(maxlen=_KEPT)).append(seconds)

    def ahead(self, kind: Kind, attempt: int) -> float:
        """Return how far ahead to take over, s.

        Args:
            kind: of plan.
            attempt: how often that was not enough for the same motion; each time it doubles.
        """
        taken = sorted(self._taken.get(kind, ()))
        expected = taken[-min(_RANK, len(taken))] if taken else _FIRST
        return min(_SHARE * expected, _LONGEST) * 2.0**attempt
