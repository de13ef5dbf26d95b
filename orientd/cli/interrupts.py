"""Ctrl-C and SIGTERM interrupt a command, whichever of its threads the kernel gives them to."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Sequence
from types import FrameType

_APART = 0.5
"""Signals within this time are one interrupt, s."""


def interrupt_at(numbers: Sequence[int]) -> None:
    """Have the signals *numbers* interrupt the main thread, which calls this.

    The kernel gives a signal to any thread of the process.  Python handles it in the main thread
    only, and does not wake a main thread that waits in a system call: the signal would be lost.
    """
    last = -math.inf

    def interrupt(number: int, _: FrameType | None) -> None:
        nonlocal last
        now = time.monotonic()
        # A second one would interrupt the end of the command, such as the wait for a stop.
        if now - last > _APART:
            last = now
            raise KeyboardInterrupt(number)

    for number in numbers:
        signal.signal(number, interrupt)
    if hasattr(signal, "pthread_kill"):
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        # Wakes a thread.  Otherwise it means nothing here, and is ignored by default.
        signal.signal(signal.SIGURG, lambda *_: None)
        waking = threading.Thread(
            target=_wake, args=(reading, threading.get_ident()), name="orientd signals", daemon=True
        )
        waking.start()


def ignore(numbers: Sequence[int]) -> None:
    """Ignore the signals *numbers* from now on."""
    for number in numbers:
        signal.signal(number, signal.SIG_IGN)


def _wake(reading: int, main: int) -> None:
    while numbers := os.read(reading, 256):
        if numbers.strip(bytes([signal.SIGURG])):
            signal.pthread_kill(main, signal.SIGURG)
