"""Notice an axis that does not follow its command: it is blocked, pushed or overloaded."""

from __future__ import annotations

from math import degrees


class FollowCheck:
    """Judges one axis by its distance from its command, measurement by measurement.

    A distance beyond the tolerance counts once it has lasted: one wrong reading is no fault.
    """

    def __init__(self, name: str, *, tolerance: float, duration: float) -> None:
        """Begin with an axis that follows.

        Args:
            name: of the axis in messages.
            tolerance: largest distance of an axis that follows, rad.
            duration: for how long it may be farther away, s.
        """
        self._name = name
        self._tolerance, self._duration = tolerance, duration
        self._since_ns: int | None = None

    def problem(self, gap: float, time_ns: int) -> str:
        """Return that the axis does not follow, or an empty string.

        Args:
            gap: angle from the measured to the commanded angle, rad.
            time_ns: time of the measurement.
        """
        apart = abs(gap)
        if apart <= self._tolerance:
            self._since_ns = None
        elif self._since_ns is None:
            self._since_ns = time_ns
        elif time_ns - self._since_ns > self._duration * 1e9:
            return (
                f"{self._name} does not follow: it is {degrees(apart):.1f} deg behind for more "
                f"than {self._duration:g} s; is it blocked, pushed or overloaded?"
            )
        return ""
