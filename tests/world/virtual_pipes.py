"""Pipes in virtual time, with the streams of Python at both ends."""

from __future__ import annotations

import io
import itertools

_NUMBERS = itertools.count(20_000_000)


class Pipe:
    """Bytes from one process to another; it takes any number of them.

    Attributes:
        number: stands for the descriptor of either end; no real one has it.
        is_read: whether anybody may read it still.
    """

    def __init__(self, scheduler):
        self._scheduler, self._bytes, self._waiting = scheduler, bytearray(), []
        self._is_written = self.is_read = True
        self.number = next(_NUMBERS)

    @property
    def is_ready(self):
        """Whether :meth:`read` returns at once."""
        return bool(self._bytes) or not self._is_written

    def read(self, most):
        """Return at most so many bytes, as soon as there are any; none at the end."""
        while not self.is_ready:
            task = self._scheduler.current()
            self._waiting.append(task)
            try:
                self._scheduler.wait()
            finally:
                self._waiting.remove(task)
        taken = bytes(self._bytes[:most])
        del self._bytes[:most]
        return taken

    def write(self, content):
        """Add bytes.

        Raises:
            BrokenPipeError: nobody reads it any more.
        """
        if not self.is_read:
            raise BrokenPipeError
        self._bytes += content
        self._wake()
        return len(content)

    def end(self):
        """Nothing more is written."""
        self._is_written = False
        self._wake()

    def _wake(self):
        for task in self._waiting:
            self._scheduler.wake(task)


class _Reader(io.RawIOBase):
    def __init__(self, pipe):
        self._pipe = pipe

    def readable(self):
        return True

    def readinto(self, buffer):
        content = self._pipe.read(len(buffer))
        buffer[: len(content)] = content
        return len(content)

    def fileno(self):
        return self._pipe.number

    def close(self):
        self._pipe.is_read = False
        super().close()


class _Writer(io.RawIOBase):
    def __init__(self, pipe):
        self._pipe = pipe

    def writable(self):
        return True

    def write(self, content):
        return self._pipe.write(bytes(content))

    def fileno(self):
        return self._pipe.number

    def close(self):
        if not self.closed:
            self._pipe.end()
        super().close()


def reader(pipe, *, is_text):
    """Return the end of a pipe to read from."""
    binary = io.BufferedReader(_Reader(pipe))
    return io.TextIOWrapper(binary, encoding="utf-8") if is_text else binary


def writer(pipe, *, is_text):
    """Return the end of a pipe to write to."""
    raw = _Writer(pipe)
    return io.TextIOWrapper(raw, encoding="utf-8", write_through=True) if is_text else raw
