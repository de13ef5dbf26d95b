"""The structured log of motions: as lines to read, or as JSON to search.

A record that is about a device, a motion or a caller says so in fields of its own.  Whatever has
the same ``device`` and ``motion_id`` is one story, from the request to the end.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from orientd.daemon.observe.log_writer import LogWriter
from orientd.one_line import one_line

_FIELD = "about"

_PRIORITIES = ((logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7))
"""Of syslog(3), which journald takes from the beginning of a line."""


class LogFormat(StrEnum):
    """How log lines look."""

    AUTO = "auto"
    TEXT = "text"
    JSON = "json"


def about(**fields: object) -> Mapping[str, Any]:
    """Return what to give a log call as ``extra``, with what it is about; nothing is left out.

    >>> about(device="arm", motion=3)
    {'about': {'device': 'arm', 'motion': 3}}
    """
    return {_FIELD: fields}


class JsonFormatter(logging.Formatter):
    """One JSON object a line."""

    def __init__(self, *, has_priority: bool) -> None:
        """Begin each line with its priority, as journald takes it, or with nothing."""
        super().__init__()
        self._has_priority = has_priority

    def format(self, record: logging.LogRecord) -> str:
        """Return *record* as a line."""
        stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created))
        told: dict[str, Any] = {
            "time": f"{stamp}.{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **getattr(record, _FIELD, {}),
        }
        if record.exc_info:
            told["error"] = self.formatException(record.exc_info)
        line = json.dumps(told, ensure_ascii=False, default=str)
        if not line.isprintable():
            # Nothing that a terminal would do something about.
            line = json.dumps(told, default=str)
        return f"<{_priority(record.levelno)}>{line}" if self._has_priority else line


class LineFormatter(logging.Formatter):
    """One line for people, whatever others have written into it."""

    def __init__(self) -> None:
        """Begin each line with the time and the level."""
        super().__init__("%(asctime)s %(levelname)s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - the library's name
        """Return *record* as a line."""
        record.message = one_line(record.message, MOST)
        return super().formatMessage(record)


MOST = 4000
"""Characters of a message."""


def set_up_log(chosen: LogFormat, level: str = "info") -> None:
    """Have the daemon log to standard error.

    Args:
        chosen: ``AUTO`` is JSON where journald reads it, lines for people anywhere else.
        level: of what is logged.
    """
    is_journal = "JOURNAL_STREAM" in os.environ
    handler = LogWriter(sys.stderr.fileno())
    if chosen is LogFormat.JSON or (chosen is LogFormat.AUTO and is_journal):
        handler.setFormatter(JsonFormatter(has_priority=is_journal))
    else:
        handler.setFormatter(LineFormatter())
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)


def _priority(level: int) -> int:
    return next((priority for least, priority in _PRIORITIES if level >= least), 7)
