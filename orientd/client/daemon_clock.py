"""The daemon's monotonic clock, as a client on any machine reads it.

A client stamps targets and poses with its own monotonic clock, and the daemon counts on its own.
Both are one clock if the two processes run on one machine.  They know it by its name, which the
daemon sends (:func:`orientd.clock.clock_name`).  Otherwise the client measures the offset.

The daemon reads its clock between the client's question and its answer, so the offset lies in an
interval as long as the round trip.  Of several trips the shortest one counts, and the estimate is
the middle of its interval (Cristian, 1989).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from orientd.clock import clock_name
from orientd.errors import OrientdError

TRIPS = 10
"""Round trips of a measurement."""

RENEWAL = 60.0
"""Age from which a measurement is repeated, s: clocks of two machines run apart."""


@dataclass(frozen=True, slots=True)
class Reading:
    """The daemon's clock, as one answer had it.

    Attributes:
        ns: the reading.
        name: of that clock; empty if not known.
    """

    ns: int
    name: str


@dataclass(frozen=True, slots=True)
class Offset:
    """How far the daemon's monotonic clock is ahead of that of this process.

    Attributes:
        ns: by how much.
        bound_ns: how far that may have been wrong when it was measured, either way; 0 on one
            machine, and half of the shortest round trip otherwise.
    """

    ns: int
    bound_ns: int


class DaemonClock:
    """The offset of the daemon's clock; safe to use from any thread."""

    def __init__(self, ask: Callable[[], Reading], *, is_local: bool) -> None:
        """Know nothing yet.

        Args:
            ask: asks the daemon for its clock.
            is_local: whether the daemon is on this machine if the names of the clocks do not tell.
        """
        self._ask, self._is_local = ask, is_local
        self._lock = threading.Lock()
        self._offset: Offset | None = None
        self._measured = 0.0

    def offset(self) -> Offset:
        """Return the offset; measure it if it is not known, or if that was :data:`RENEWAL` ago.

        If the daemon does not answer a second measurement, the first one counts for as long again.

        Raises:
            OrientdError: the daemon does not answer the first measurement.
        """
        with self._lock:
            known = self._offset
            is_due = time.monotonic() - self._measured > RENEWAL
            if known is not None and (not known.bound_ns or not is_due):
                return known
            self._measured = time.monotonic()
            try:
                self._offset = known = self._measure()
            except OrientdError:
                if known is None:
                    raise
            return known

    def _measure(self) -> Offset:
        best: Offset | None = None
        for _ in range(TRIPS):
            asked_ns = time.monotonic_ns()
            there = self._ask()
            answered_ns = time.monotonic_ns()
            if self._is_ours(there.name) and asked_ns <= there.ns <= answered_ns:
                return Offset(0, 0)
            bound_ns = (answered_ns - asked_ns + 1) // 2
            if best is None or bound_ns < best.bound_ns:
                best = Offset(there.ns - asked_ns - bound_ns, bound_ns)
        if best is None:
            raise ValueError("a measurement has at least one trip")
        return best

    def _is_ours(self, name: str) -> bool:
        """Return whether the daemon's clock of this *name* is that of this process."""
        ours = clock_name()
        return name == ours if name and ours else self._is_local
