"""The controller's clock in terms of ours."""

from __future__ import annotations

_HALF_WINDOW_NS = 500_000_000
_LATE_NS = 20_000_000
_MANY = 25


class ControllerClock:
    """Translate the controller's timestamps into monotonic nanoseconds.

    A package that took the least time on its way tells the offset between the two clocks best, so
    the offset is the smallest seen in the last half to whole second.  What a package was late
    beyond that is the age of its contents.  Late ones in a row, and many of them, mean that the
    controller's clock has stood still for a while: then the offset is theirs.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the controller may have been frozen or started again."""
        self._current = self._previous = 0
        self._window_ends_ns = -1
        self._late = 0
        self._least_late = 0
        self._last_ns = 0

    def measured_ns(self, timestamp: float, now_ns: int) -> int:
        """Return when *timestamp* (s, the controller's) was, given that it was just read.

        Never later than *now_ns*, never earlier than the last answer.
        """
        stamp_ns = round(timestamp * 1e9)
        offset = now_ns - stamp_ns
        if self._window_ends_ns < 0:
            self._current = self._previous = offset
            self._window_ends_ns = now_ns + _HALF_WINDOW_NS
        elif now_ns >= self._window_ends_ns:
            self._previous, self._current = self._current, offset
            self._window_ends_ns = now_ns + _HALF_WINDOW_NS
        else:
            self._current = min(self._current, offset)
        least = min(self._current, self._previous)
        if offset - least > _LATE_NS:
            self._least_late = min(self._least_late, offset) if self._late else offset
            self._late += 1
            if self._late == _MANY:
                self._current = self._previous = least = self._least_late
                self._late = 0
        else:
            self._late = 0
        measured = stamp_ns + least
        self._last_ns = max(self._last_ns, min(measured, now_ns))
        return self._last_ns
