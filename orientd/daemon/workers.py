"""Threads of the daemon: who waits for whom, which work runs where, and what may delay it.

Nothing uses asyncio's default executor, which everything would share.

=============================  ===============================  ===============================
work                           threads                          what may delay it
=============================  ===============================  ===============================
stops of a device: Stop,       ``DeviceWorkers.stops``, one     an earlier stop of the same
Halt, a cancelled motion, a    for each device                  device
caller that has gone, a lease
that has ended, SIGTERM
commands of a device: enable,  ``DeviceWorkers.commands``, one  an earlier command of the same
disable, reset, pause, speed,  for each device                  device
the start of a motion, the
end of hand guiding
names of users                 :data:`LOOK_UPS`, two            other look-ups; nobody waits
                                                                longer than :data:`LOOK_UP`
digests of large requests,     :data:`DIGESTS`, one             digests that came before; only
for the audit log                                               large requests wait for one
start and end of the daemon    ``Threads`` of the server, one   the devices, as far as their
                                                                stops allow
settings that are read again   ``Threads`` of the server, one   files, the name service,
                                                                servos that do not answer
leases, routes, reports        the event loop                   nothing: none of it waits
heartbeat, feeding, events     a thread for each device         nothing but the driver's
                                                                explanation of a fault
=============================  ===============================  ===============================
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar, TypeVarTuple

LOOK_UP = 0.25
"""How long a new connection waits for the name of its user, s; then the number stands for it."""

Result = TypeVar("Result")
Given = TypeVarTuple("Given")

_Work = tuple[Future[Any], Callable[[], Any]]


class Threads:
    """Threads that do work in the order in which it comes.

    They begin with the first work, and do not keep the process from ending.

    Attributes:
        latest: the work that came last, if any has come.
    """

    def __init__(self, count: int, name: str) -> None:
        """Start nothing yet.

        Args:
            count: how many there are.
            name: of each.
        """
        self._count, self._name = count, name
        self._lock = threading.Lock()
        self._queue: queue.SimpleQueue[_Work | None] | None = None
        self.latest: Future[Any] | None = None

    def submit(self, work: Callable[[*Given], Result], *given: *Given) -> Future[Result]:
        """Have *work* done, and return at once."""
        future: Future[Result] = Future()
        with self._lock:
            if self._queue is None:
                self._queue = queue.SimpleQueue()
                for _ in range(self._count):
                    threading.Thread(
                        target=_do, args=(self._queue,), name=self._name, daemon=True
                    ).start()
            self._queue.put((future, partial(work, *given)))
            self.latest = future
        return future

    async def run(self, work: Callable[[*Given], Result], *given: *Given) -> Result:
        """Have *work* done, and return its result.

        Work that has begun is done to its end even if the caller is cancelled.
        """
        return await asyncio.wrap_future(self.submit(work, *given))

    def close(self) -> None:
        """End once the work that has come is done; return at once."""
        with self._lock:
            waiting, self._queue = self._queue, None
        if waiting is not None:
            for _ in range(self._count):
                waiting.put(None)


def _do(waiting: queue.SimpleQueue[_Work | None]) -> None:
    """Do work as it comes, until there is ``None``."""
    while (item := waiting.get()) is not None:
        future, work = item
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(work())
            except BaseException as error:  # noqa: BLE001 - whoever waits for it gets it
                future.set_exception(error)
        del item, future, work  # what they hold must not be kept until the next one comes


class DeviceWorkers:
    """The threads of one device, which can delay itself only.

    Attributes:
        stops: end motions.  Nothing else is done there.
        commands: everything that may take as long as the device does.
    """

    def __init__(self, device: str) -> None:
        self.stops = Threads(1, f"stop {device}")
        self.commands = Threads(1, f"command {device}")

    def close(self) -> None:
        """End once the work that has come is done; return at once."""
        self.stops.close()
        self.commands.close()


LOOK_UPS = Threads(2, "look-up")
"""Ask the name service, which may never answer."""

DIGESTS = Threads(1, "digest")
"""Describe large requests, which takes milliseconds."""


class LoopErrors:
    """Log the first unexpected error of a loop, which continues in spite of it."""

    def __init__(self, logger: logging.Logger, what: str) -> None:
        """Note none yet.

        Args:
            logger: of the module.
            what: what does not work if there are any.
        """
        self._logger, self._what = logger, what
        self._is_told = False

    @contextlib.contextmanager
    def logged(self) -> Iterator[None]:
        """Continue after the context, whatever it raises."""
        try:
            yield
        except Exception:  # or the loop would end without a word
            if not self._is_told:
                self._logger.exception("%s", self._what)
            self._is_told = True
