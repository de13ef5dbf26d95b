"""The last seconds of a device as strips: the largest values of short spans of time.

Every cycle counts: each span shows its worst cycle, not one that was picked from it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from orientd.floats import difference, norm
from orientd.stream.records import Cycle

SPAN = 0.05
"""s; one value of every strip."""

COUNT = 200
"""Spans that are kept."""

COLUMNS = (
    "velocity", "velocity_x", "velocity_y", "velocity_z", "velocity_measured",
    "acceleration", "acceleration_x", "acceleration_y", "acceleration_z",
    "tracking_error", "lateness",
)  # fmt: skip
"""Commanded: norms and magnitudes of the body-frame components, rad/s and rad/s^2.  Measured: the
norm, rad/s.  Then the angle between measured and commanded orientation, rad, and lateness, s."""

Row = tuple[int, *tuple[float | None, ...]]
"""Number of a span, and the largest value of each column in it; ``None`` if nothing is known."""

_SPAN_NS = round(SPAN * 1e9)


class Strips:
    """The strips of one device; threads may read and write them at the same time."""

    def __init__(self, lead_cycles: int = 0) -> None:
        """Begin empty; *lead_cycles* is how many cycles early setpoints are sent."""
        self._lock = threading.Lock()
        self._sent = deque[tuple[int, tuple[float, ...]]](maxlen=lead_cycles + 1)
        self._lead_cycles = lead_cycles
        self._rows = deque[Row](maxlen=COUNT)

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Add cycles in their order."""
        with self._lock:
            for cycle in cycles:
                span, values = cycle.deadline_ns // _SPAN_NS, self._values(cycle)
                newest = self._rows[-1][0] if self._rows else span - 1
                if span < newest:
                    self._rows.clear()  # a servo with another clock
                if span != newest:
                    self._rows.append((span, *values))
                else:
                    self._rows[-1] = (span, *map(_larger, self._rows[-1][1:], values))

    def since(self, span: int) -> list[Row]:
        """Return the rows from number *span* on, oldest first."""
        with self._lock:
            return [row for row in self._rows if row[0] >= span]

    def _values(self, cycle: Cycle) -> tuple[float | None, ...]:
        self._sent.append((cycle.index, cycle.q))
        return (
            norm(cycle.omega_body),
            *(abs(part) for part in cycle.omega_body),
            norm(cycle.feedback_omega_body) if cycle.has_feedback else None,
            norm(cycle.alpha_body),
            *(abs(part) for part in cycle.alpha_body),
            self._error(cycle),
            cycle.lateness_ns * 1e-9,
        )

    def _error(self, cycle: Cycle) -> float | None:
        """Return the angle between the measurement and the setpoint sent one lead ago."""
        index, q = self._sent[0]
        if not cycle.has_feedback or cycle.index - index != self._lead_cycles:
            return None
        return norm(difference(q, cycle.feedback_q))  # type: ignore[arg-type] # four of them


def _larger(a: float | None, b: float | None) -> float | None:
    return b if a is None else a if b is None else max(a, b)
