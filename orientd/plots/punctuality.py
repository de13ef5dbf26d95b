"""Charts of how punctual the cycles of a motion were."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from orientd.plots.charts import MOST_POINTS, Traces, mark_keyframes
from orientd.plots.paper import AXES, GRID, INK, LIMIT, PAPER, tidy
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LATE = AXES[2].colour
TRACKING = "#b9770e"

LEAST = 1e-3
"""Milliseconds below which a lateness is drawn as this much."""


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """How punctual the cycles of a motion were.

    Attributes:
        times: s, as in the traces.
        lateness: s, shape ``(n,)``.
        tracking_error: angle between sent and reported, rad, shape ``(n,)``.
        period: s.
    """

    times: Floats
    lateness: Floats
    tracking_error: Floats
    period: float


def draw_lateness(axes: Axes, traces: Traces, timing: Timing) -> None:
    """Draw lateness and tracking error over time."""
    tidy(axes, "lateness, ms")
    mark_keyframes(axes, traces)
    step = max(1, len(timing.times) // MOST_POINTS)
    late = np.maximum(1e3 * timing.lateness, LEAST)
    axes.scatter(timing.times[::step], late[::step], s=3, color=LATE, linewidth=0)
    axes.axhline(500.0 * timing.period, color=LIMIT, linewidth=1.2, linestyle=":")
    axes.set_yscale("log")
    axes.annotate(
        "half a period",
        (timing.times[-1], 500.0 * timing.period),
        ha="right",
        va="bottom",
        fontsize=8,
        color=LIMIT,
    )
    error = 1e3 * timing.tracking_error
    if np.any(np.isfinite(error)):
        other = axes.twinx()
        other.plot(timing.times[::step], error[::step], color=TRACKING, linewidth=1.0)
        other.set_ylabel("tracking error, mrad", fontsize=9, color=TRACKING)
        other.tick_params(labelsize=8, colors=TRACKING)
        other.set_ylim(bottom=0.0)
        other.spines[["top", "left"]].set_visible(False)


def draw_histogram(axes: Axes, timing: Timing) -> None:
    """Draw how many cycles were how late, with the percentiles that matter."""
    late = np.maximum(1e3 * timing.lateness, LEAST)
    lowest = float(late.min(initial=1e-2))
    bins = np.geomspace(0.8 * lowest, 1.25 * max(float(late.max(initial=0.0)), 0.1), 60)
    axes.hist(late, bins=bins.tolist(), color=LATE, alpha=0.85)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0.0)
    tidy(axes, "cycles")
    axes.set_xlabel("lateness, ms", fontsize=9, color=INK)
    shares = [50.0, 99.0, 99.9, 100.0]
    # Cycles that there were, as in the summary: between the last few interpolation is a guess.
    exact = 1e3 * timing.lateness
    where = (
        np.percentile(exact, shares, method="inverted_cdf").tolist() if len(exact) else [0.0] * 4
    )
    names = ("p50", "p99", "p99.9", "max")
    for place, stroke in zip(where, ("-", "--", "-.", ":"), strict=True):
        axes.axvline(max(place, LEAST), color=INK, linewidth=0.9, linestyle=stroke)
    axes.annotate(
        "\n".join(f"{name}  {place:.3f} ms" for name, place in zip(names, where, strict=True)),
        (0.98, 0.97),
        xycoords="axes fraction",
        ha="right",
        va="top",
        fontsize=9,
        color=INK,
        bbox={"facecolor": PAPER, "edgecolor": GRID},
    )
