"""Real time on Linux: scheduling, locked memory, absolute deadlines, through the C library.

``SCHED_FIFO`` and locked memory need a permission (``RLIMIT_RTPRIO``, ``RLIMIT_MEMLOCK``).  Without
``SCHED_FIFO``, a scheduler slice of 0.1 ms halves the worst delays and needs no permission.  The
process reports the scheduling that it got.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import platform
import struct
import time

SLICE_NS = 100_000
"""Requested scheduler slice without SCHED_FIFO: the shortest that the kernel grants."""

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
_SCHED_ATTR = struct.Struct("@IIQiIQQQ")  # size policy flags nice priority runtime deadline period


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class DeadlineTimer:
    """Sleep until absolute times of the monotonic clock."""

    def __init__(self, spin_ns: int = 0) -> None:
        """Busy-wait through the last *spin_ns* nanoseconds before a deadline."""
        self._spin_ns = spin_ns
        self._timespec = _Timespec()
        self._pointer = ctypes.byref(self._timespec)
        self._nanosleep = ctypes.CDLL(None).clock_nanosleep

    def wait(self, deadline_ns: int) -> int:
        """Return the wake-up time, at or after *deadline_ns*."""
        timespec = self._timespec
        timespec.seconds, timespec.nanoseconds = divmod(deadline_ns - self._spin_ns, 1_000_000_000)
        while self._nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, self._pointer, None) != 0:
            pass  # interrupted by a signal; the deadline is absolute
        now = time.monotonic_ns()
        while now < deadline_ns:
            now = time.monotonic_ns()
        return now


def set_scheduling(priority: int) -> str:
    """Request ``SCHED_FIFO`` at *priority* (0: no request), otherwise a short slice.

    It applies to every existing thread, because a client library receives in its own threads.
    Otherwise the device's data would wait behind all other work of the machine.  Threads that start
    later inherit it.

    Returns:
        A description of the resulting scheduling.
    """
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    if priority > 0:
        first_come = os.sched_param(priority)
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, first_come)
        except OSError:
            pass
        else:
            for thread in _threads():
                with contextlib.suppress(ProcessLookupError):
                    os.sched_setscheduler(thread, os.SCHED_FIFO, first_come)
            return f"SCHED_FIFO {priority}"
    number = _SCHED_SETATTR.get(platform.machine())
    if number is not None:
        attributes = ctypes.create_string_buffer(
            _SCHED_ATTR.pack(_SCHED_ATTR.size, os.SCHED_OTHER, 0, 0, 0, SLICE_NS, 0, 0)
        )
        syscall = ctypes.CDLL(None).syscall
        own, *_ = [syscall(number, thread, attributes, 0) for thread in (0, *_threads())]
        if own == 0:
            return f"SCHED_OTHER, slice {SLICE_NS / 1e6:g} ms"
    return "SCHED_OTHER"


def _threads() -> list[int]:
    """Return the kernel's numbers of this process's threads."""
    return [int(name) for name in os.listdir("/proc/self/task")]  # noqa: PTH208 - no pathlib here


def lock_memory() -> bool:
    """Keep every touched page in memory; return whether the system permits it."""
    flags = _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT
    return bool(ctypes.CDLL(None).mlockall(flags) == 0)


def freeze_garbage() -> None:
    """Collect garbage once, then never again: the cycle path creates no reference cycles."""
    gc.collect()
    gc.freeze()
    gc.disable()
