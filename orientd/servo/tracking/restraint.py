"""How much acceleration a correction may take while a moving target is followed closely.

Packets that are lost or late are surprises: the target turns out to be elsewhere than it was
expected.  In all, its own acceleration included, what is made up for takes no more than the target
itself has lately taken, so that a bad network does not show as a peak of its own; where the target
accelerates as much as it ever does, the correction waits.
"""

from __future__ import annotations

from math import inf

from orientd.driver import Vector3
from orientd.floats import norm

FORGETTING = 0.02
"""By which part the target's largest acceleration is forgotten in a second."""

LEAST_PART = 0.05
"""Part of the limit that a correction may always take."""


class Restraint:
    """The largest acceleration of the target, and whether it is followed closely.

    It is from when what is left of angle and velocity would take no more than the target's own
    acceleration, until the tracker has to catch up again with all that the limits allow.
    """

    def __init__(self, period: float) -> None:
        """Expect a target every *period* seconds."""
        self._kept = 1.0 - FORGETTING * period
        self.release()

    def release(self) -> None:
        """Begin to catch up with another target."""
        self._largest = 0.0
        self._is_close = False

    def room(self, alpha: Vector3, needed: float, limit: float) -> float:
        """Return how much acceleration is left for a correction; infinity while catching up.

        Args:
            alpha: angular acceleration of the target, rad/s^2.
            needed: what making up for angle and velocity takes, each by itself, rad/s^2; infinity
                where nothing has to be restrained.
            limit: on angular acceleration, rad/s^2.
        """
        size = norm(alpha)
        self._largest = max(size, self._kept * self._largest, LEAST_PART * limit)
        self._is_close = needed < inf and (self._is_close or needed <= self._largest)
        return self._largest - size if self._is_close else inf

    def held(self, wanted: Vector3, *, is_linear: bool) -> Vector3:
        """Return the acceleration to aim at, no more than the target's while it is close.

        Args:
            wanted: what the law asks for, rad/s^2.
            is_linear: whether it asks for a correction, not for catching up.
        """
        self._is_close = self._is_close and is_linear
        size = norm(wanted)
        if not self._is_close or size <= self._largest:
            return wanted
        s = self._largest / size
        return (s * wanted[0], s * wanted[1], s * wanted[2])
