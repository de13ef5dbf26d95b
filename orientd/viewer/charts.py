"""The charts of a device: the strips of its last seconds, and the lines of each chart.

A strip has the largest values of short spans of time.  Every cycle counts: each span shows its
worst cycle, not one that was picked from it.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from math import isfinite
from typing import Any

from orientd.floats import difference, norm
from orientd.model.limits import AXES, Limits
from orientd.protocol import control_pb2 as pb
from orientd.protocol.limits import limits_from_message
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

_SOLID: list[int] = []
_DASHED, _DOTTED, _DASH_DOT = [9, 4], [2, 3], [8, 3, 2, 3]
_AXIS_TINTS, _AXIS_DASHES = ("--x", "--y", "--z"), (_SOLID, _DASHED, _DASH_DOT)

Chart = dict[str, Any]
"""``title``; ``scale`` from the unit of the strips to that of the chart; and ``lines``.  A line
shows a ``column`` of the strips or a constant ``level``, by ``name``, ``tint`` and ``dashes``."""


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


def charts_of(device: pb.DeviceReport, certificate: pb.Certificate | None) -> list[Chart]:
    """Return the charts of a device, with its limits, or those of the motion if they are lower."""
    lowest = {} if certificate is None else {
        "velocity": certificate.peak_velocity.limit,
        "acceleration": certificate.peak_acceleration.limit,
    }  # fmt: skip
    limits = limits_from_message(device.limits)
    velocity = _rates(limits, "velocity", lowest)
    if len(velocity) == 2:
        velocity.insert(1, _strip("measured", "velocity_measured", "--x", _DASHED))
    return [
        _chart("Velocity, rad/s", 1.0, velocity),
        _chart("Acceleration, rad/s²", 1.0, _rates(limits, "acceleration", lowest)),
        _chart("Tracking error, mrad", 1e3, [_strip("largest", "tracking_error", "--z", _SOLID)]),
        _chart(
            "Lateness, ms",
            1e3,
            [
                _strip("largest", "lateness", "--z", _SOLID),
                _level("half a period", 0.5 / device.rate_hz),
            ],
        ),
    ]


def _rates(limits: Limits, name: str, lowest: dict[str, float]) -> list[Chart]:
    """Return the lines of a commanded rate and its limit, or of its body-frame components."""
    limit = limits.rate(name)
    if isinstance(limit, float | int):
        lines = [_strip("sent", name, "--z", _SOLID)]
        level = min(limit, lowest.get(name, limit))
        return lines + [_level("limit", level)] * isfinite(level)
    lines = []
    for axis, level, tint, dashes in zip(AXES, limit, _AXIS_TINTS, _AXIS_DASHES, strict=True):
        lines.append(_strip(axis, f"{name}_{axis}", tint, dashes))
        if isfinite(level):
            lines.append(_level(f"limit {axis}", level, tint))
    return lines


def _chart(title: str, scale: float, lines: list[Chart]) -> Chart:
    return {"title": title, "scale": scale, "lines": lines}


def _strip(name: str, column: str, tint: str, dashes: list[int]) -> Chart:
    place = 1 + COLUMNS.index(column)  # the first of a row is the number of its span
    return {"name": name, "column": place, "tint": tint, "dashes": dashes}


def _level(name: str, level: float, tint: str = "--limit") -> Chart:
    return {"name": name, "column": None, "level": level, "tint": tint, "dashes": _DOTTED}
