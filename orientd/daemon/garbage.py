"""What the garbage collection of the daemon need not look at any more.

A full collection looks at every object that there is.  With the planner and its compiled kernels
these are 140,000, for which it takes nearly a tenth of a second; nobody is served meanwhile.  What
was loaded stays for good, so it is looked at once and then left out.
"""

from __future__ import annotations

import gc
import sys
import threading


def spare() -> None:
    """Leave out of every collection to come what there is now."""
    gc.collect()
    gc.freeze()


class LateSparing:
    """Spares what loads behind the first motions: the planner, and then its kernels.

    Kernels that must be compiled first leave a million objects, which would be looked at again and
    again for half a second each time: what one leaves is spared before the next is compiled.
    """

    def __init__(self) -> None:
        """Wait for them."""
        self._lock = threading.Lock()
        self._is_due = True

    def expect(self) -> None:
        """Have kernels spared one by one; cheap, and to be called before every plan."""
        if self._is_due:
            from orientd.curves.fast import KERNEL
            from orientd.planner.fast import KERNELS

            KERNEL.after_each = KERNELS.after_each = spare

    def look(self) -> None:
        """Spare it once all of it is there; cheap, and to be called after every plan."""
        if not (self._is_due and _is_loaded()):
            return
        with self._lock:
            if self._is_due:
                self._is_due = False
                spare()


def _is_loaded() -> bool:
    if "orientd.planner.fast" not in sys.modules:
        return False
    from orientd.curves.fast import KERNEL, Status
    from orientd.planner.fast import KERNELS

    without = (Status.MISSING, Status.FAILED)
    return KERNEL.status in without or KERNELS.status in (Status.READY, *without)
