"""Threads to plan in: few at a time, none of which keeps the daemon from ending."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Result = TypeVar("Result")


class Planners:
    """Run work in threads that end with the process, unlike those of an executor."""

    def __init__(self, most: int) -> None:
        """Run up to *most* pieces of work at a time; more of them would only take turns."""
        self._turns = threading.BoundedSemaphore(most)

    def submit(self, work: Callable[[], Result]) -> Future[Result]:
        """Begin *work* as soon as it is its turn, unless its future is cancelled before."""
        future: Future[Result] = Future()
        threading.Thread(target=self._run, args=(work, future), name="plan", daemon=True).start()
        return future

    def _run(self, work: Callable[[], Result], future: Future[Result]) -> None:
        with self._turns:
            if not future.set_running_or_notify_cancel():
                return
            try:
                result = work()
            except BaseException as error:  # noqa: BLE001 - it is raised where the result is asked for
                future.set_exception(error)
            else:
                future.set_result(result)
