"""The daemon's log: lines for people, or JSON for programs.

A record that is about a device, a motion or a caller has these as fields of its own.
"""

from __future__ import annotations

import io
import json
import logging
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Mapping
from enum import StrEnum
from logging.handlers import QueueHandler, QueueListener
from typing import Any

from orientd.one_line import one_line

_log = logging.getLogger(__name__)

MOST_LINES = 1000
"""Log lines that may wait for a reader."""

PATIENCE = 1.0
"""Time that the last log lines may take at the end of the process, s."""

MOST = 4000
"""Characters of a message."""

_FIELD = "about"

_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7))
"""Of syslog(3), which journald takes from the beginning of a line."""


class LogFormat(StrEnum):
    """How log lines look."""

    AUTO = "auto"
    TEXT = "text"
    JSON = "json"


def about(**fields: object) -> Mapping[str, Any]:
    """Return what to give a log call as ``extra``: the fields of the record.

    >>> about(device="arm", motion=3)
    {'about': {'device': 'arm', 'motion': 3}}
    """
    return {_FIELD: fields}


def json_line(fields: Mapping[str, Any]) -> str:
    r"""Return *fields* as one line of JSON that no terminal acts on.

    >>> json_line({"text": "\x1b[2J"})
    '{"text": "\\u001b[2J"}'
    """
    line = json.dumps(fields, ensure_ascii=False, default=str)
    return line if line.isprintable() else json.dumps(fields, default=str)


class JsonFormatter(logging.Formatter):
    """One JSON object a line."""

    def __init__(self, *, has_priority: bool) -> None:
        """Begin each line with its priority, as journald takes it, or with nothing."""
        super().__init__()
        self._has_priority = has_priority

    def format(self, record: logging.LogRecord) -> str:
        """Return *record* as a line."""
        stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        fields: dict[str, Any] = {
            "time": f"{stamp}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, _FIELD, {}),
        }
        if record.exc_info:
            fields["error"] = self.formatException(record.exc_info)
        line = json_line(fields)
        return f"<{_priority(record.levelno)}>{line}" if self._has_priority else line


def _in_one_line(record: logging.LogRecord) -> bool:
    """Make the message of *record* one line, whatever others have written into it."""
    record.msg, record.args = one_line(record.getMessage(), MOST), ()
    return True


class BackgroundHandler(QueueHandler):
    """Hand records to another handler in a thread of its own, so that no caller waits.

    A full disk, a terminal stopped by Ctrl-S or a full pipe would otherwise block the thread that
    feeds a servo, and so interrupt the motion.  Records that find the queue full are left out.
    """

    def __init__(
        self,
        handler: logging.Handler,
        tell_lost: Callable[[int], object],
        *,
        most_waiting: int,
        caught_up: Callable[[], object] = lambda: None,
    ) -> None:
        """Start the thread.

        Args:
            handler: writes each record, however long that takes.
            tell_lost: called from the thread with the number of records left out since the last
                call.
            most_waiting: records that may wait.
            caught_up: called from the thread whenever it has written all that waited.
        """
        waiting: queue.Queue[Any] = queue.Queue(most_waiting)
        super().__init__(waiting)
        self._listener: _Listener | None = _Listener(waiting, handler, tell_lost, caught_up)
        self._listener.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Hand over *record* with its text as it is now, at once, or count it."""
        record.msg, record.args = record.getMessage(), ()
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            if self._listener is not None:
                self._listener.lost += 1

    def close(self, patience: float | None = PATIENCE) -> None:
        """Wait until the last record is written, at most *patience* s."""
        listener, self._listener = self._listener, None
        if listener is not None:
            # Daemon threads: the writer may wait for a reader who never comes.
            ending = threading.Thread(target=listener.stop, daemon=True)
            ending.start()
            ending.join(patience)
        super().close()


class _Listener(QueueListener):
    """Write what comes, and tell what was left out."""

    def __init__(
        self,
        waiting: queue.Queue[Any],
        handler: logging.Handler,
        tell_lost: Callable[[int], object],
        caught_up: Callable[[], object],
    ) -> None:
        super().__init__(waiting, handler)
        self.lost = 0
        self._waiting, self._tell_lost, self._caught_up = waiting, tell_lost, caught_up

    def handle(self, record: logging.LogRecord) -> None:
        super().handle(record)
        if self._waiting.empty():
            if self.lost:
                lost, self.lost = self.lost, 0
                self._tell_lost(lost)
            self._caught_up()

    def enqueue_sentinel(self) -> None:
        self._waiting.put(None)  # waits until there is space


def writer(descriptor: int) -> logging.Handler:
    """Return a handler that writes lines to a file descriptor, which may block.

    It has no lock and shares no stream: the end of the process waits for neither.
    """
    handler = logging.StreamHandler(
        io.TextIOWrapper(
            io.FileIO(descriptor, "w", closefd=False),
            encoding="utf-8",
            errors="replace",
            write_through=True,
        )
    )
    handler.lock = None
    return handler


def _tell_lost(lost: int) -> None:
    _log.warning("%d log lines are lost: nobody has read the ones before them", lost)


def set_up_log(chosen: LogFormat, level: str = "info") -> None:
    """Log to standard error.

    Args:
        chosen: ``AUTO`` is JSON if journald reads it, lines for people otherwise.
        level: the least level that is logged.
    """
    is_journal = "JOURNAL_STREAM" in os.environ
    handler = writer(sys.stderr.fileno())
    if chosen is LogFormat.JSON or (chosen is LogFormat.AUTO and is_journal):
        handler.setFormatter(JsonFormatter(has_priority=is_journal))
    else:
        handler.addFilter(_in_one_line)
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    behind = BackgroundHandler(handler, _tell_lost, most_waiting=MOST_LINES)
    logging.basicConfig(handlers=[behind], level=level.upper(), force=True)


def _priority(level: int) -> int:
    return next((priority for least, priority in _PRIORITIES if level >= least), 7)
