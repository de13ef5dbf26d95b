"""Write lines in a thread of its own, so that no caller waits for a full disk or an unread pipe.

The standard library's queue handler and listener do most of that.  But if the queue is full, the
handler prints a traceback for every line, to the same blocked stream.  And the listener waits for
its thread without a timeout.
"""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable


class DetachedWriter:
    """Take lines at once, and write them in order."""

    def __init__(
        self,
        write: Callable[[bytes], object],
        lost: Callable[[int], object],
        *,
        name: str,
        most_waiting: int,
    ) -> None:
        """Start the thread.

        Args:
            write: writes a line, however long that takes.
            lost: called from the thread with the number of lines lost since the last call.
            name: of the thread.
            most_waiting: lines that may wait; the writer loses and counts any more.
        """
        self._write, self._tell_lost = write, lost
        self._lines: queue.Queue[bytes | None] = queue.Queue(most_waiting)
        self._lost = 0
        self._is_closed = threading.Event()
        # A daemon thread: it may be waiting for a reader who never comes.
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    @property
    def is_empty(self) -> bool:
        """Whether the thread has taken every line."""
        return self._lines.empty()

    def put(self, line: bytes) -> None:
        """Write *line* in the background; return at once."""
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            self._lost += 1

    def close(self, patience: float | None = None) -> None:
        """Wait until the last line is written, at most *patience* s."""
        if self._is_closed.is_set():
            return
        self._is_closed.set()
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(None)
        self._thread.join(patience)

    def _work(self) -> None:
        while not (self._is_closed.is_set() and self._lines.empty()):
            line = self._lines.get()
            if line is not None:
                self._write(line)
            if self._lost and self._lines.empty():
                lost, self._lost = self._lost, 0
                self._tell_lost(lost)
