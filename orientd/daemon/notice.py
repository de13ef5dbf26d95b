"""How far ahead of the device a motion is to be left for one that is yet to be planned."""

from __future__ import annotations

from collections import deque

_FIRST = 0.002
"""How long planning takes, s, before that has been measured."""

_LONGEST = 0.25
"""As far ahead as that at the most, s, where it has not been too late before."""

_KEPT, _RANK = 8, 3
_SHARE = 1.25
_HAND_OVER = 0.003
"""How long it takes beyond planning until the servo can see the motion, s."""


class Notice:
    """Foretell how long planning and handing over take, from how long planning took before.

    That is by the third longest of the last few: one that was held up, by what had to be loaded or
    by the machine, does not make those after it wait.
    """

    def __init__(self) -> None:
        self._taken: deque[float] = deque(maxlen=_KEPT)

    def add(self, seconds: float) -> None:
        """Take note of how long planning took."""
        self._taken.append(seconds)

    def ahead(self, attempt: int) -> float:
        """Return how far ahead to leave, s.

        Args:
            attempt: how often that was not enough for the same motion; each time it doubles.
        """
        taken = sorted(self._taken)
        expected = taken[-min(_RANK, len(taken))] if taken else _FIRST
        return min(_SHARE * expected + _HAND_OVER, _LONGEST) * 2.0**attempt
