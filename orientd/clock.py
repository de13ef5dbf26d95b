"""The monotonic clock of the machine, and its name."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol


class Clock(Protocol):
    """Tell the time in integer monotonic nanoseconds."""

    def now_ns(self) -> int:
        """Return the present time in nanoseconds; never decreases."""
        ...


class MonotonicClock:
    """The machine's ``CLOCK_MONOTONIC``, in nanoseconds since an arbitrary start."""

    now_ns = staticmethod(time.monotonic_ns)


def clock_name() -> str:
    """Return a name of the machine's monotonic clock; empty if the system does not tell.

    Two processes have the same name exactly if they read the same clock.  It says which run of
    which kernel this is, and in which of its time namespaces: a container may have its own.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        namespace = Path("/proc/self/ns/time").stat().st_ino
    except (OSError, ValueError):
        return ""
    return f"{boot} {namespace}"
