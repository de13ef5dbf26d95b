"""The audit log: one line of JSON for everything that was asked of the daemon and what came of it.

The file is only ever appended to.  When it is large enough it is put aside under the next number,
``audit.jsonl.1`` being the newest of those, and another is begun.

The standard library's rotating handler would lose records here: two daemons of one user share the
file, and each would move it from under the other.  It also follows a symbolic link, and leaves who
may read to the umask.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
import queue
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_log = logging.getLogger(__name__)

MOST_WAITING = 10_000
"""Records that wait for a slow disk; more are left out, and counted."""

_Record = Mapping[str, Any]


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
        self._waiting: queue.Queue[_Record | None] = queue.Queue(MOST_WAITING)
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
                self._write({"time": time.time(), "event": "left out", "records": left_out})
            self._write(record)

    def _write(self, record: _Record) -> None:
        line = json.dumps(_stamped(record), ensure_ascii=False, default=str).encode() + b"\n"
        try:
            if self._descriptor < 0:
                self._open()
            if os.fstat(self._descriptor).st_size + len(line) > self._most_bytes:
                self._rotate()
            os.write(self._descriptor, line)
        except OSError as error:
            # A full disk must not keep anybody from stopping a robot.
            if not self._is_failing:
                _log.error("audit: cannot write to %s: %s", self._path, error)
            self._is_failing = True
        else:
            self._is_failing = False

    def _open(self) -> None:
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        self._descriptor = os.open(self._path, flags, 0o600)

    def _rotate(self) -> None:
        """Put the file aside, unless another daemon of the same user just did."""
        descriptor = self._descriptor
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        try:
            if self._path.exists() and os.path.samestat(os.fstat(descriptor), self._path.stat()):
                for number in range(self._most_files - 1, 0, -1):
                    if self._aside(number).exists():
                        self._aside(number).replace(self._aside(number + 1))
                self._path.replace(self._aside(1))
        finally:
            self._descriptor = -1
            os.close(descriptor)
        self._open()

    def _aside(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


def _stamped(record: _Record) -> dict[str, Any]:
    seconds = record["time"]
    stamp = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(seconds))
    return {**record, "time": f"{stamp}.{int(seconds % 1 * 1e6):06d}Z"}
