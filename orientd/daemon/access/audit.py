"""The audit log: one line of JSON for everything that was asked of the daemon and what came of it.

The file is only ever appended to, and its lines are a chain (``audit_chain.py``); what comes again
and again is counted (``repeats.py``).  When it is large enough it is put aside under the next
number, ``audit.jsonl.1`` being the newest of those, and another is begun.

The standard library's rotating handler would lose records here: two daemons of one user share the
file, and each would move it from under the other.  It also follows a symbolic link, and leaves who
may read to the umask.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import queue
import threading
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from orientd.daemon.access.audit_chain import chained, digest, end_of
from orientd.daemon.access.claim import is_same_file
from orientd.daemon.access.repeats import Repeats

_log = logging.getLogger(__name__)

MOST_WAITING = 10_000
"""Records that wait for a slow disk; more are left out, and counted."""

_LOOK = 1.0
"""How often it is looked what of the counted is to be written, s."""

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
        self._end = -1
        self._last = 0, ""
        self._repeats = Repeats()
        self._is_failing = False
        self._left_out = 0
        self._waiting: queue.Queue[_Record | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._write_all, name="audit", daemon=True)
        self._thread.start()

    def record(self, **fields: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Have *fields* written, with the time, or counted; returns at once."""
        try:
            self._waiting.put_nowait({"time": time.time(), **fields})
        except queue.Full:
            self._left_out += 1

    def close(self) -> None:
        """Write what waits and what was counted, and end."""
        self._waiting.put(None)
        self._thread.join()
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
            _log.info("audit: ends with line %d, %s", *self._last)

    def _write_all(self) -> None:
        is_last = False
        while not is_last:
            try:
                record = self._waiting.get(timeout=_LOOK)
            except queue.Empty:
                due = self._repeats.due(time.monotonic())
            else:
                is_last = record is None
                now = time.monotonic()
                due = self._repeats.due(now, is_last=is_last)
                left_out, self._left_out = self._left_out, 0
                if left_out:
                    due.append({"time": time.time(), "event": "left out", "records": left_out})
                if record is not None:
                    due += self._repeats.take(record, now)
            for one in due:
                self._write(one)

    def _write(self, record: _Record) -> None:
        try:
            self._append(_stamped(record))
        except OSError as error:
            # A full disk must not keep anybody from stopping a robot.
            if not self._is_failing:
                _log.error("audit: cannot write to %s: %s", self._path, error)
            self._is_failing = True
        else:
            self._is_failing = False

    def _append(self, record: dict[str, Any]) -> None:
        """Write the next line of the chain, which another daemon of this user may go on with."""
        try:
            size, line = self._next(record)
            if size and size + len(line) > self._most_bytes:
                self._put_aside()
                size, line = self._next(record)
            written = os.write(self._descriptor, line)
            if written < len(line):
                os.ftruncate(self._descriptor, size)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self._end, self._last = size + written, (self._last[0] + 1, digest(line[:-1]))
        finally:
            if self._descriptor >= 0:
                fcntl.flock(self._descriptor, fcntl.LOCK_UN)

    def _next(self, record: dict[str, Any]) -> tuple[int, bytes]:
        """Lock the file; return its length, and *record* as the line that follows."""
        self._lock()
        size = os.fstat(self._descriptor).st_size
        if size != self._end:
            size = self._find_end(size)
        number, previous = self._last
        return size, chained(record, number + 1, previous)

    def _lock(self) -> None:
        """Hold the file at the path alone, opened anew where another daemon has put it aside."""
        while True:
            if self._descriptor < 0:
                self._open()
            fcntl.flock(self._descriptor, fcntl.LOCK_EX)
            if is_same_file(self._descriptor, self._path):
                return
            os.close(self._descriptor)
            self._descriptor, self._end = -1, -1

    def _open(self) -> None:
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
        self._descriptor = os.open(self._path, flags, 0o600)

    def _find_end(self, size: int) -> int:
        """Take up the chain where the file ends, or the one before it; return the file's length."""
        if size:
            number, previous, is_whole = end_of(self._descriptor)
            if not is_whole:
                # Whoever wrote it was killed meanwhile: what is there stays, as a line of its own.
                size += os.write(self._descriptor, b"\n")
        else:
            number, previous = self._end_aside()
        if self._end < 0 and not self._last[0]:
            _log.info("audit: goes on after line %d, %s", number, previous or "the first one")
        self._last = number, previous
        return size

    def _end_aside(self) -> tuple[int, str]:
        try:
            descriptor = os.open(self._aside(1), os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        except OSError:
            return 0, ""
        try:
            number, previous, _ = end_of(descriptor)
            return number, previous
        finally:
            os.close(descriptor)

    def _put_aside(self) -> None:
        """Put the file aside, under the lock, and let go of it."""
        for number in range(self._most_files - 1, 0, -1):
            if self._aside(number).exists():
                self._aside(number).replace(self._aside(number + 1))
        self._path.replace(self._aside(1))
        os.close(self._descriptor)
        self._descriptor, self._end = -1, -1

    def _aside(self, number: int) -> Path:
        return self._path.with_name(f"{self._path.name}.{number}")


def _stamped(record: _Record) -> dict[str, Any]:
    """Return *record* with its times as text."""
    times = {
        name: datetime.fromtimestamp(record[name], UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        for name in ("time", "since")
        if name in record
    }
    return {**record, **times}
