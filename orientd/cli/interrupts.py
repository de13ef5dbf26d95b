"""Ctrl-C and SIGTERM interrupt a command, whichever of its threads the kernel gives them to."""

from __future__ import annotations

import math
import signal
import socket
import threading
import time
from collections.abc import Callable, Sequence
from types import FrameType

_APART = 0.5
"""Signals within this time are one interrupt, s."""

_WAKE = signal.SIGURG
"""Wakes the main thread; unlike most signals it is ignored by default, and means nothing here."""


class Interrupt:
    """Raise ``KeyboardInterrupt``, only once for signals in quick succession.

    A second one would interrupt the end of the command, such as the wait for a stop.
    """

    _last = -math.inf

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Interrupt the main thread, unless it was interrupted just now."""
        now = time.monotonic()
        if now - self._last > _APART:
            self._last = now
            signal.default_int_handler(number, frame)


def handle(numbers: Sequence[int], handler: Callable[..., object] | signal.Handlers) -> None:
    """Handle the signals *numbers* from now on."""
    for number in numbers:
        signal.signal(number, handler)


def wake_main_thread() -> None:
    """Have every signal wake the main thread, which calls this.

    The kernel gives a signal to any thread of the process.  Python handles it in the main thread
    only, and does not wake a main thread that waits in a system call: the signal would be lost.
    """
    reading, writing = socket.socketpair()
    writing.setblocking(False)
    signal.signal(_WAKE, lambda *_: None)
    signal.set_wakeup_fd(writing.detach(), warn_on_full_buffer=False)
    threading.Thread(
        target=_wake, args=(reading, threading.get_ident()), name="orientd signals", daemon=True
    ).start()


def _wake(reading: socket.socket, main: int) -> None:
    while numbers := reading.recv(256):
        if numbers.strip(bytes([_WAKE])):
            signal.pthread_kill(main, _WAKE)
