"""When a time on the wall's clock comes, on the monotonic one: the same for all who ask."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

KEPT_INSTANTS = 64
"""Start times that are remembered, for the motions of other devices."""


class Instants:
    """Times since the epoch with the instants that they were taken for when first asked about."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._instants: OrderedDict[int, int] = OrderedDict()

    def of(self, time_ns: int) -> int:
        """Return when it will be *time_ns* since the epoch, on the monotonic clock.

        Whoever asks for the same time is given the same instant, whatever is done to the clock on
        the wall meanwhile.
        """
        with self._lock:
            if time_ns not in self._instants:
                self._instants[time_ns] = time.monotonic_ns() + time_ns - time.time_ns()
                while len(self._instants) > KEPT_INSTANTS:
                    self._instants.popitem(last=False)
            return self._instants[time_ns]
