"""The audit log: one line of JSON for every command, and for everything that was refused.

When the file is large enough it becomes ``audit.jsonl.1``, and the daemon starts another.  Daemons
of one user may share a file: a lock keeps two from writing or renaming at once.  The file is synced
whenever no record waits, so a power cut costs the records of the last moment alone.
"""

from __future__ import annotations

import fcntl
import logging
import os
import sys
from contextlib import suppress
from datetime import UTC, datetime
from io import TextIOWrapper
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import Any

from orientd.config import AccessSettings
from orientd.daemon.access.claim import is_same_file
from orientd.daemon.log import BackgroundHandler, json_line
from orientd.daemon.report_directory import report_directory
from orientd.files import sync_name

_log = logging.getLogger(__name__)

MOST_WAITING = 10_000
"""Records that wait for a slow disk; more are left out, and counted."""


def audit_path(access: AccessSettings) -> Path:
    """Return where commands are recorded."""
    return access.audit or Path(report_directory()) / "audit.jsonl"


class AuditLog:
    """Write records in a thread of its own, so that no call waits for a disk."""

    def __init__(self, path: Path, *, most_bytes: int, most_files: int) -> None:
        """Append to *path* from now on.

        Args:
            path: of the file; its directory is made if need be.
            most_bytes: size at which another file is begun.
            most_files: older files that are kept.
        """
        file = _OwnFile(path, maxBytes=most_bytes, backupCount=most_files, delay=True)
        self._handler = BackgroundHandler(
            file, self._tell_lost, most_waiting=MOST_WAITING, caught_up=file.sync
        )
        self._file = file

    def record(self, **fields: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write *fields* with the time in the background; return at once."""
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        line = json_line({"time": now, **fields})
        self._handler.handle(logging.makeLogRecord({"msg": line}))

    def close(self) -> None:
        """Write what waits, and end."""
        self._handler.close(None)
        self._file.sync()
        self._file.close()

    def _tell_lost(self, lost: int) -> None:
        self.record(event="left out", records=lost)


class _OwnFile(RotatingFileHandler):
    """A file that only its user may read, and that is no link to another one."""

    _is_failing = False

    def _open(self) -> TextIOWrapper:
        descriptor = self._own(self.baseFilename, os.O_RDWR | os.O_APPEND)
        file = os.fdopen(descriptor, "a", encoding="utf-8")
        size = os.fstat(descriptor).st_size
        if size and os.pread(descriptor, 1, size - 1) != b"\n":
            file.write("\n")  # A full disk or a power cut has cut the last line.
        sync_name(Path(self.baseFilename))
        return file

    def sync(self) -> None:
        """Have the disk keep what is written; a disk that fails has been logged already."""
        if self.stream is not None:
            with suppress(OSError):
                os.fsync(self.stream.fileno())

    def doRollover(self) -> None:  # noqa: N802 - the library's name
        self.sync()
        super().doRollover()

    def emit(self, record: logging.LogRecord) -> None:
        had_failed, self._is_failing = self._is_failing, False
        try:
            with os.fdopen(self._own(f"{self.baseFilename}.lock", os.O_RDWR)) as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                self._follow()
                super().emit(record)
        except OSError:
            self.handleError(record)
        if self._is_failing and not had_failed:
            # A full disk must not keep a client from stopping a robot.
            _log.error("audit: cannot write to %s: %s", self.baseFilename, self._problem)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - the library's name
        del record
        self._is_failing, self._problem = True, sys.exception()
        self._let_go()

    def _follow(self) -> None:
        """Leave a file that another daemon has put aside."""
        file = self.stream
        if file is not None and not is_same_file(file.fileno(), Path(self.baseFilename)):
            self._let_go()

    def _let_go(self) -> None:
        self.sync()
        stream, self.stream = self.stream, None
        if stream is not None:
            with suppress(OSError):
                stream.close()

    @staticmethod
    def _own(path: str, flags: int) -> int:
        Path(path).parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        return os.open(path, flags | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
