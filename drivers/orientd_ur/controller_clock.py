"""The controller's clock in terms of ours."""

from __future__ import annotations

_HALF_WINDOW_NS = 500_000_000


class ControllerClock:
    """Translate the controller's timestamps into monotonic nanoseconds.

    A package that took the least time on its way tells the offset between the two clocks best, so
    the offset is the smallest seen in the last half to whole second.  What a package was late
    beyond that is the age of its contents.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the controller may have been frozen or started again."""
        self._current = self._previous = 0
        self._window_ends_ns = -1
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
        measured = stamp_ns + min(self._current, self._previous)
        self._last_ns = max(self._last_ns, min(measured, now_ns))
        return self._last_ns
