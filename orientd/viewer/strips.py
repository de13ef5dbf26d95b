"""The last seconds of a device as strips: the largest values of short spans of time.

Every cycle counts: what is drawn of a span is its worst cycle, not one that was picked from it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

import numpy as np

from orientd.floats import difference, norm
from orientd.rotation import Floats
from orientd.stream import Cycle

SPAN = 0.05
"""s; one value of every strip."""

COUNT = 200
"""Spans that are kept."""

NAMES = (
    "velocity",
    "velocity_x",
    "velocity_y",
    "velocity_z",
    "velocity_measured",
    "acceleration",
    "acceleration_x",
    "acceleration_y",
    "acceleration_z",
    "tracking_error",
    "lateness",
)
"""Of the strips: rad/s and rad/s^2 as sent, of the norm or the sizes of the body's components; the
norm in rad/s as measured; the angle to where the device is to be, rad; s."""

_SPAN_NS = round(SPAN * 1e9)


class Strips:
    """The strips of one device; may be read and written by different threads."""

    def __init__(self, lead_cycles: int = 0) -> None:
        """Begin with nothing known.

        Args:
            lead_cycles: by how many cycles setpoints are sent before their time.
        """
        self._lock = threading.Lock()
        self._sent = deque[tuple[int, tuple[float, ...]]](maxlen=lead_cycles + 1)
        self._lead_cycles = lead_cycles
        self._values: Floats = np.full((len(NAMES), COUNT), np.nan)
        self._newest = 0

    def add(self, cycles: Sequence[Cycle]) -> None:
        """Take in cycles, in the order in which they happened."""
        if not cycles:
            return
        columns = np.array([self._column(cycle) for cycle in cycles], dtype=np.float64).T
        spans = np.array([cycle.deadline_ns for cycle in cycles]) // _SPAN_NS
        with self._lock:
            newest = int(spans[-1])
            if abs(newest - self._newest) >= COUNT:
                self._values[:] = np.nan
            elif newest > self._newest:
                self._values = np.roll(self._values, self._newest - newest, axis=1)
                self._values[:, self._newest - newest :] = np.nan
            self._newest = newest
            places = spans - newest + COUNT - 1
            is_kept = (places >= 0) & (places < COUNT)
            for place in np.unique(places[is_kept]):
                block = columns[:, places == place]
                worst = np.fmax.reduce(block, axis=1)
                self._values[:, place] = np.fmax(self._values[:, place], worst)

    def read(self) -> tuple[Floats, dict[str, Floats]]:
        """Return the ends of the spans, s before now and so not above 0, and the strips by name.

        Where nothing is known a strip is not a number.
        """
        with self._lock:
            values = self._values.copy()
        times = np.arange(1.0 - COUNT, 1.0) * SPAN
        return times, dict(zip(NAMES, values, strict=True))

    def _column(self, cycle: Cycle) -> tuple[float, ...]:
        self._sent.append((cycle.index, cycle.q))
        return (
            norm(cycle.omega_body),
            *(abs(part) for part in cycle.omega_body),
            norm(cycle.feedback_omega_body) if cycle.has_feedback else np.nan,
            norm(cycle.alpha_body),
            *(abs(part) for part in cycle.alpha_body),
            self._error(cycle),
            cycle.lateness_ns * 1e-9,
        )

    def _error(self, cycle: Cycle) -> float:
        """Return the angle between what is measured and what was sent a lead ago, or no number."""
        index, q = self._sent[0]
        if not cycle.has_feedback or cycle.index - index != self._lead_cycles:
            return np.nan
        return norm(difference(q, cycle.feedback_q))  # type: ignore[arg-type] # four of them
