"""The charts of a device: which there are, and the lines of each."""

from __future__ import annotations

from math import isfinite
from typing import Any

from orientd.model.limits import AXES, Limits
from orientd.protocol import control_pb2 as pb
from orientd.protocol.limits import limits_from_message
from orientd.viewer.strips import COLUMNS

_SOLID: list[int] = []
_DASHED, _DOTTED, _DASH_DOT = [9, 4], [2, 3], [8, 3, 2, 3]
_AXIS_TINTS, _AXIS_DASHES = ("--x", "--y", "--z"), (_SOLID, _DASHED, _DASH_DOT)

Chart = dict[str, Any]
"""``title``; ``scale`` from the unit of the strips to that of the chart; and ``lines``.  A line
shows a ``column`` of the strips or a constant ``level``, by ``name``, ``tint`` and ``dashes``."""


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
