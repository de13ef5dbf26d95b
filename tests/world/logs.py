"""The logs of daemons in virtual time: each has the records of its own tasks."""

from __future__ import annotations

import contextlib
import logging


class _Logs(logging.Handler):
    """Write the records of a task to the log of its process."""

    def __init__(self, world):
        super().__init__()
        self._world = world
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))

    def emit(self, record):
        task = self._world.scheduler.current()
        log = None if task is None else self._world.log_of(task.group)
        if log is not None and not log.closed:
            log.write(f"{self.format(record)}\n".encode())
            log.flush()


@contextlib.contextmanager
def logs(world):
    """Write the logs of a world's daemons within the context."""
    root, handler = logging.getLogger(), _Logs(world)
    before = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    try:
        yield
    finally:
        root.setLevel(before)
        root.removeHandler(handler)
