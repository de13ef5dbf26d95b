"""A bound on calls into a library that may never return, nor let another thread run."""

from __future__ import annotations

import faulthandler
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def process_ends_after(seconds: float) -> Iterator[None]:
    """End the process, exit status 1, when the block takes longer than *seconds*.

    The client library's constructors hold the interpreter's lock, so neither a Python thread nor a
    signal handler could interfere; the watchdog of :mod:`faulthandler` is a thread of C.  Whoever
    supervises the process sees its end; its traceback goes to standard error.
    """
    faulthandler.dump_traceback_later(seconds, exit=True, file=sys.__stderr__ or sys.stderr)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def arm(seconds: float) -> tuple[float, float]:
    """Have the kernel end the process after *seconds*; for calls made every cycle.

    A timer of the kernel costs a microsecond.  Its signal, SIGALRM, ends the process unless
    somebody handles it, whatever the library is doing.

    Returns:
        What was armed before, for :func:`disarm`.
    """
    return signal.setitimer(signal.ITIMER_REAL, seconds)


def disarm(before: tuple[float, float]) -> None:
    """Put back what was armed before."""
    signal.setitimer(signal.ITIMER_REAL, *before)
