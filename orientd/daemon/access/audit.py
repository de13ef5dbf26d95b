"""The audit log: one line of JSON for every command, and for everything that was refused.

When the file is large enough it is put aside under the next number, ``audit.jsonl.1`` being the
newest of those, and another is begun.  The standard library's rotating handler would lose records
here: two daemons of one user share the file, and each would move it from under the other.  It also
follows a symbolic link, and leaves who may read to the umask.
"""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import queue
import threading
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from orientd.config import AccessSettings
from orientd.daemon.access.claim import is_same_file
from orientd.daemon.devices import report_directory

_log = logging.getLogger(__name__)

MOST_WAITING = 10_000
"""Records that wait for a slow disk; more are left out, and counted."""


def audit_path(access: AccessSettings) -> Path:
    """Return where commands are recorded."""
    return access.audit or Path(report_directory()) / "audit.jsonl"


class AuditLog:
    """Write records in a thread of its own: no call waits for a disk."""

    def __init__(self, path: Path, *, most_bytes: int, most_files: int) -> None:
        """Begin to write to the end of *path*.

        Args:
            path: where; the directory is made if need be.
            most_bytes: how large the file becomes.
            most_files: how many are kept besides it.
        """
        self._path = path
        self._most_bytes = most_bytes
        self._most_files = most_files
        self._descriptor = -1
        self._is_failing = False
        self._left_out = 0
        self._waiting: queue.Queue[dict[str, Any] | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write_all, name="audit", daemon=True)
        self._thread.start()

    def record(self, **fields: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Have *fields* written, with the time; returns at once."""
        try:
            self._waiting.put_nowait({"time": time.time(), **fields})
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Write what waits, and end."""
        self._waiting.put(None)
        self._thread.join()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _write_all(self) -> None:
        while (record := self._waiting.get()) is not None:
            left_out, self._left_out = self._left_out, 0
            if left_out:
                self._write({"time": record["time"], "event": "left out", "records": left_out})
            self._write(record)

    def _write(self, record: dict[str, Any]) -> None:
        try:
            self._append(_line(record))
        except OSError as error:
            # A full disk must not keep anybody from stopping a robot.
            if not self._is_failing:
                _log.error("audit: cannot write to %s: %s", self._path, error)
            self._is_failing = True
        else:
            self._is_failing = False

    def _append(self, line: bytes) -> None:
        self._lock()
        try:
            size = os.fstat(self._descriptor).st_size
            if size and size + len(line) > self._most_bytes:
                self._put_aside()
                self._lock()
                size = os.fstat(self._descriptor).st_size
            if os.write(self._descriptor, line) < len(line):
                os.ftruncate(self._descriptor, size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            if self._descriptor >= 0:
                fcntl.flock(self._descriptor, fcntl.LOCK_UN)

    def _lock(self) -> None:
        """Hold the file at the path alone, opened anew where another daemon has put it aside."""
        while True:
            if self._descriptor < 0:
                self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
                self._descriptor = os.open(self._path, flags, 0o600)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX)
            if is_same_file(self._descriptor, self._path):
                return
            os.close(self._descriptor)
            self._descriptor = -1

    def _put_aside(self) -> None:
        """Put the file aside, under the lock, and let go of it."""
        for number in range(self._most_files - 1, 0, -1):
            if self._aside(number).exists():
                self._aside(number).replace(self._aside(number + 1))
        self._path.replace(self._aside(1))
        os.close(self._descriptor)
        self._descriptor = -1

    def _aside(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


def _line(record: dict[str, Any]) -> bytes:
    """Return *record* as a line, with its time as text."""
    stamp = datetime.fromtimestamp(record["time"], UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    content = {**record, "time": stamp}
    line = json.dumps(content, ensure_ascii=False, default=str)
    if not line.isprintable():
        # A terminal must not obey what somebody has put into a text.
        line = json.dumps(content, default=str)
    return line.encode() + b"\n"
