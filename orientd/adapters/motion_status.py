"""The status of an action that runs in the background, for bluesky."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Self


class MotionStatus:
    """The state of an action, as bluesky's protocol ``Status`` has it.

    Attributes:
        is_stop_success: whether the action counts as successful if it is stopped.
    """

    def __init__(self) -> None:
        self.is_stop_success = False
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self._error: BaseException | None = None
        self._callbacks: list[Callable[[Any], None]] = []

    @property
    def done(self) -> bool:
        """Whether the action has ended, in any way."""
        return self._ended.is_set()

    @property
    def success(self) -> bool:
        """Whether it has ended without an error."""
        return self.done and self._error is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Return the error of the action, or ``None``.

        Args:
            timeout: longest wait for its end, s; ``None`` for no limit.

        Raises:
            TimeoutError: it has not ended.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError(f"the action has not ended after {timeout:g} s")
        return self._error

    def add_callback(self, callback: Callable[[Any], None]) -> None:
        """Call *callback* with this object at the end of the action; at once if it has ended."""
        with self._lock:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def finish(self, error: BaseException | None = None) -> Self:
        """End the action, with an error if it failed, and return this object."""
        with self._lock:
            self._error = error
            self._ended.set()
        for callback in self._callbacks:
            callback(self)
        return self
