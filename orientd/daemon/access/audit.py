"""The audit log: one line of JSON for every command, and for everything that was refused.

When the file is large enough it is put aside under the next number, ``audit.jsonl.1`` being the
newest of those, and another is begun.  The standard library's rotating handler would lose records
here: two daemons of one user share the file, and each would move it from under the other.  It also
follows a symbolic link, and leaves who may read to the umask.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from orientd.config import AccessSettings
from orientd.daemon.access.claim import is_same_file
from orientd.daemon.observe import DetachedWriter, json_line
from orientd.daemon.report_directory import report_directory

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
        self._path = path
        self._most_bytes = most_bytes
        self._most_files = most_files
        self._descriptor = -1
        self._is_failing = False
        self._writer = DetachedWriter(
            self._write, self._tell_lost, name="audit", most_waiting=MOST_WAITING
        )

    def record(self, **fields: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Write *fields* with the time in the background; return at once."""
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        self._writer.put(f"{json_line({'time': now, **fields})}\n".encode())

    def close(self) -> None:
        """Write what waits, and end."""
        self._writer.close()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _tell_lost(self, lost: int) -> None:
        self.record(event="left out", records=lost)

    def _write(self, line: bytes) -> None:
        try:
            self._append(line)
        except OSError as error:
            # A full disk must not keep a client from stopping a robot.
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
                self._rotate()
                self._lock()
                size = os.fstat(self._descriptor).st_size
            if os.write(self._descriptor, line) < len(line):
                os.ftruncate(self._descriptor, size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            if self._descriptor >= 0:
                fcntl.flock(self._descriptor, fcntl.LOCK_UN)

    def _lock(self) -> None:
        """Lock the file at the path; open it again if another daemon has rotated it."""
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

    def _rotate(self) -> None:
        """Rotate the file while locked, and close it."""
        for number in range(self._most_files - 1, 0, -1):
            if self._aside(number).exists():
                self._aside(number).replace(self._aside(number + 1))
        self._path.replace(self._aside(1))
        os.close(self._descriptor)
        self._descriptor = -1

    def _aside(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")
