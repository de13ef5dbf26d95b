"""The daemon's log lines on their way out: whoever logs never waits for whoever reads.

The standard library's queue handler and listener do the same up to the point where nobody reads: a
full queue makes the handler write a traceback for every line, to the very stream that is not read,
and the listener's end waits for its thread for as long as that takes.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import threading

_log = logging.getLogger(__name__)

MOST_LINES = 1000
"""Lines that wait for a reader, at most; what comes after that is lost, and counted."""

PATIENCE = 1.0
"""So long the end of the process waits for the last lines to be read, s."""


class LogWriter(logging.Handler):
    """Writes log lines to a file descriptor, from a thread of its own.

    A terminal held by Ctrl-S or a pipe that nobody reads would otherwise hold up the thread that
    keeps a servo informed, and with it the motion.
    """

    def __init__(self, descriptor: int) -> None:
        """Write to *descriptor*, which may block."""
        super().__init__()
        self._descriptor = descriptor
        self._lines: queue.Queue[bytes] = queue.Queue(MOST_LINES)
        self._lost = 0
        self._is_closed = threading.Event()
        # A daemon thread: it may be waiting for a reader who never comes.
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Have *record* written, or count it as lost where too many lines wait already."""
        try:
            self._lines.put_nowait(f"{self.format(record)}\n".encode(errors="replace"))
        except queue.Full:
            self._lost += 1

    def close(self) -> None:
        """Wait for the last lines, but not for long."""
        if not self._is_closed.is_set():
            self._is_closed.set()
            with contextlib.suppress(queue.Full):
                self._lines.put_nowait(b"")
            self._thread.join(PATIENCE)
        super().close()

    def _work(self) -> None:
        while not (self._is_closed.is_set() and self._lines.empty()):
            self._write(self._lines.get())
            if self._lost and self._lines.empty():
                lost, self._lost = self._lost, 0
                _log.warning("%d log lines are lost: nobody has read the ones before them", lost)

    def _write(self, line: bytes) -> None:
        with contextlib.suppress(OSError):  # the reader is gone
            while line:
                line = line[os.write(self._descriptor, line) :]
