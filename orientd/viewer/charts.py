"""The strip charts: which there are for a device, and how they are drawn.

A line is told from another by its dashes as well as by its colour; the title shows them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
import viser
from viser import uplot

from orientd.planner import AXES, Limits
from orientd.rotation import Floats
from orientd.rpc import DeviceReport, Plan
from orientd.viewer.strips import COUNT, SPAN

HEIGHT = 130
_SOLID: tuple[int, ...] = ()
_DASHED = (9, 4)
_DASHED_AND_DOTTED = (8, 3, 2, 3)
_DOTTED = (2, 3)
_LOOKS = {_SOLID: "━━", _DASHED: "╍╍", _DASHED_AND_DOTTED: "━·", _DOTTED: "┈┈"}
_OF_AXES = (_SOLID, _DASHED, _DASHED_AND_DOTTED)
_COLOURS = ("#d6542c", "#2e9e72", "#4270d8")
_SENT, _MEASURED, _LIMIT = "#4270d8", "#d6542c", "#a04ec2"


@dataclass(frozen=True, slots=True)
class ChartLine:
    """One line of a chart.

    Attributes:
        label: in the legend.
        colour: readable on white and on black.
        dashes: strokes and gaps, pixels.
        strip: which one it shows; empty for a level.
        level: where it is, in the chart's unit, if it shows no strip.
        quantity: whose limit it is, where a motion may have a narrower one.
    """

    label: str
    colour: str
    dashes: tuple[int, ...]
    strip: str = ""
    level: float = 0.0
    quantity: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """One chart.

    Attributes:
        title: what, and in which unit.
        scale: from the unit of the strips to that of the chart.
        lines: in it.
    """

    title: str
    scale: float
    lines: tuple[ChartLine, ...]

    @property
    def heading(self) -> str:
        """The title, with the lines as they look."""
        return f"{self.title}:  " + "   ".join(
            f"{_LOOKS[line.dashes]} {line.label}" for line in self.lines
        )

    def data(
        self, times: Floats, strips: Mapping[str, Floats], limits: Mapping[str, float]
    ) -> tuple[Floats, ...]:
        """Return times and the values of each line, in the chart's unit.

        Args:
            times: of the values, s.
            strips: by name.
            limits: of the motion, by quantity.
        """
        lines = [
            strips[line.strip] * self.scale
            if line.strip
            else np.full(len(times), min(line.level, limits.get(line.quantity, np.inf)))
            for line in self.lines
        ]
        return (times, *lines)


def limits_of(plan: Plan | None) -> dict[str, float]:
    """Return the limits that a motion was planned with, by quantity."""
    if plan is None:
        return {}
    certificate = plan.certificate
    return {
        "velocity": certificate.peak_velocity.limit,
        "acceleration": certificate.peak_acceleration.limit,
    }


def charts_of(device: DeviceReport) -> list[Chart]:
    """Return the charts for a device, with its limits."""
    velocity = _rates(device.limits, "velocity")
    if len(velocity) == 2:
        velocity.insert(1, ChartLine("measured", _MEASURED, _DASHED, "velocity_measured"))
    half_a_period = 0.5e3 / device.rate_hz
    return [
        Chart("Angular velocity, rad/s", 1.0, tuple(velocity)),
        Chart("Angular acceleration, rad/s²", 1.0, tuple(_rates(device.limits, "acceleration"))),
        Chart(
            "Tracking error, mrad", 1e3, (ChartLine("largest", _SENT, _SOLID, "tracking_error"),)
        ),
        Chart(
            "Lateness of cycles, ms",
            1e3,
            (
                ChartLine("largest", _SENT, _SOLID, "lateness"),
                ChartLine("half a period", _LIMIT, _DOTTED, level=half_a_period),
            ),
        ),
    ]


def _rates(limits: Limits, name: str) -> list[ChartLine]:
    """Return the line of what was sent and that of its limit, or those of the body's axes."""
    limit = limits.rate(name)
    if isinstance(limit, float | int):
        lines = [ChartLine("sent", _SENT, _SOLID, name)]
        if isfinite(limit):
            lines.append(ChartLine("limit", _LIMIT, _DOTTED, level=limit, quantity=name))
        return lines
    lines = []
    for axis, level, colour, dashes in zip(AXES, limit, _COLOURS, _OF_AXES, strict=True):
        lines.append(ChartLine(axis, colour, dashes, f"{name}_{axis}"))
        if isfinite(level):
            lines.append(ChartLine(f"limit {axis}", colour, _DOTTED, level=level))
    return lines


class Charts:
    """The charts on the page."""

    def __init__(self, server: viser.ViserServer, device: DeviceReport) -> None:
        """Draw the charts of *device*, empty."""
        times = np.arange(1.0 - COUNT, 1.0) * SPAN
        nothing = np.full(COUNT, np.nan)
        self._charts = charts_of(device)
        self._handles: list[Any] = [
            server.gui.add_uplot(
                data=(times, *(nothing for _ in chart.lines)),
                series=(uplot.Series(label="s"), *map(_series, chart.lines)),
                title=chart.heading,
                scales={
                    "x": uplot.Scale(time=False, range=(float(times[0]), 0.0)),
                    "y": uplot.Scale(range=(0.0, None)),
                },
                axes=(uplot.Axis(size=24), uplot.Axis(size=44)),
                legend=uplot.Legend(show=False),
                cursor=uplot.Cursor(show=False),
                height=HEIGHT,
                padding=(4, 12, 0, 0),
            )
            for chart in self._charts
        ]

    def show(self, times: Floats, strips: Mapping[str, Floats], plan: Plan | None) -> None:
        """Draw the strips as they are now, with the limits of *plan*."""
        limits = limits_of(plan)
        for chart, handle in zip(self._charts, self._handles, strict=True):
            handle.data = chart.data(times, strips, limits)

    def remove(self) -> None:
        """Take the charts off the page."""
        for handle in self._handles:
            handle.remove()


def _series(line: ChartLine) -> uplot.Series:
    return uplot.Series(
        label=line.label,
        stroke=line.colour,
        width=2,
        dash=line.dashes,
        points=uplot.Series_Points(show=False),
    )
