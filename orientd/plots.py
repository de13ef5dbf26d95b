"""Pictures of motions, by Matplotlib (extra ``plot``), without windows and without global state.

One colour belongs to one axis throughout: in the traces of the tool's axes on the unit sphere and
in the components of every vector.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpl_toolkits.mplot3d  # noqa: F401 - makes the projection "3d" known
import numpy as np
from matplotlib.figure import Figure

from orientd.errors import OrientdError
from orientd.planner import Motion
from orientd.rotation import Floats, rotate

AXES = "xyz"
COLOURS = ("#c0392b", "#1e8449", "#2457a8")
INK, GRID, LIMIT, SHADE = "#222222", "#dddddd", "#8e44ad", "#f1eee6"

VIEW = (24.0, 35.0)
"""Elevation and azimuth from which the sphere is seen, degrees."""

MOST_POINTS = 4000
"""Points in one line of a chart; more cannot be seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """What a chart of a motion shows.

    Attributes:
        times: s, shape ``(n,)``.
        q: orientations, tool to world, shape ``(n, 4)``.
        omega_body: rad/s, shape ``(n, 3)``.
        alpha_body: rad/s^2, shape ``(n, 3)``.
        keyframe_times: s.
        keyframe_q: orientations of the keyframes, shape ``(k, 4)``.
        velocity_limit: rad/s.
        acceleration_limit: rad/s^2.
    """

    times: Floats
    q: Floats
    omega_body: Floats
    alpha_body: Floats
    keyframe_times: Floats
    keyframe_q: Floats
    velocity_limit: float
    acceleration_limit: float


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


def draw_motion(path: Path, motion: Motion, *, title: str) -> None:
    """Draw a planned motion to *path*, whose ending names the format.

    Raises:
        OrientdError: the file cannot be written, or Matplotlib knows no such format.
    """
    times = np.linspace(0.0, motion.duration, MOST_POINTS)
    samples = motion.sample(times)
    traces = Traces(
        times=times,
        q=samples.q,
        omega_body=samples.omega_body,
        alpha_body=samples.alpha_body,
        keyframe_times=motion.keyframe_times,
        keyframe_q=motion.sample(motion.keyframe_times).q,
        velocity_limit=motion.limits.velocity,
        acceleration_limit=motion.limits.acceleration,
    )
    figure = Figure(figsize=(12.0, 6.5), layout="constrained", facecolor="white")
    charts = figure.subplot_mosaic(
        [["sphere", "velocity"], ["sphere", "acceleration"]],
        per_subplot_kw={"sphere": {"projection": "3d"}},
        width_ratios=[1.0, 1.25],
    )
    _headline(figure, title)
    _fill(charts, traces)
    charts["acceleration"].set_xlabel("time, s")
    _save(figure, path)


def draw_sent(path: Path, traces: Traces, timing: Timing, *, title: str) -> None:
    """Draw what was sent of a motion, and how punctually, to *path*.

    Raises:
        OrientdError: the file cannot be written, or Matplotlib knows no such format.
    """
    figure = Figure(figsize=(13.0, 9.0), layout="constrained", facecolor="white")
    charts = figure.subplot_mosaic(
        [["sphere", "velocity"], ["sphere", "acceleration"], ["histogram", "lateness"]],
        per_subplot_kw={"sphere": {"projection": "3d"}},
        width_ratios=[1.0, 1.25],
    )
    _headline(figure, title)
    _fill(charts, traces)
    _lateness(charts["lateness"], traces, timing)
    _histogram(charts["histogram"], timing)
    charts["lateness"].set_xlabel("time, s")
    _save(figure, path)


def _headline(figure: Any, title: str) -> None:  # noqa: ANN401 - Matplotlib has no types
    figure.suptitle(title, x=0.01, ha="left", fontsize=14, color=INK, fontweight="bold")


def _fill(charts: Any, traces: Traces) -> None:  # noqa: ANN401 - Matplotlib has no types
    _sphere(charts["sphere"], traces)
    _components(
        charts["velocity"],
        traces,
        traces.omega_body,
        "angular velocity, rad/s",
        traces.velocity_limit,
    )
    _components(
        charts["acceleration"],
        traces,
        traces.alpha_body,
        "angular acceleration, rad/s²",
        traces.acceleration_limit,
    )
    charts["velocity"].legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, frameon=False, fontsize=9
    )


def _sphere(axes: Any, traces: Traces) -> None:  # noqa: ANN401 - Matplotlib has no types
    """Draw where the tips of the tool's three axes go on the unit sphere, fainter at its back."""
    around, up = np.linspace(0.0, 2.0 * np.pi, 73), np.linspace(0.0, np.pi, 37)
    x, y = np.outer(np.cos(around), np.sin(up)), np.outer(np.sin(around), np.sin(up))
    z = np.outer(np.ones_like(around), np.cos(up))
    axes.computed_zorder = False
    axes.plot_surface(x, y, z, color="#f2f2f2", alpha=0.35, linewidth=0, shade=False)
    axes.plot_wireframe(x, y, z, rstride=12, cstride=6, color=GRID, linewidth=0.5)
    elevation, azimuth = np.radians(VIEW)
    viewer = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    step = max(1, len(traces.q) // MOST_POINTS)
    for axis, colour, name in zip(np.eye(3), COLOURS, AXES, strict=True):
        trace = rotate(traces.q[::step], axis)
        is_front = (trace @ viewer > 0.0)[:, None]
        axes.plot(*np.where(is_front, np.nan, trace).T, color=colour, linewidth=1.5, alpha=0.35)
        axes.plot(*np.where(is_front, trace, np.nan).T, color=colour, linewidth=2.2)
        marks = rotate(traces.keyframe_q, axis)
        strength = np.where(marks @ viewer > 0.0, 1.0, 0.35)
        axes.scatter(
            *marks.T, c=colour, s=30, edgecolor="white", depthshade=False, alpha=strength, zorder=5
        )
        axes.text(*(marks[0] * 1.13), name, color=colour, ha="center", va="center", weight="bold")
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.35)
    axes.set_axis_off()
    axes.view_init(*VIEW)
    axes.set_title(
        "the tool's axes on the unit sphere;\ndots are keyframes, letters where it begins",
        fontsize=10,
        color=INK,
        y=0.97,
    )


def _components(
    axes: Any,  # noqa: ANN401 - Matplotlib has no types
    traces: Traces,
    vectors: Floats,
    what: str,
    limit: float,
) -> None:
    step = max(1, len(vectors) // MOST_POINTS)
    times, shown = traces.times[::step], vectors[::step]
    _prepare(axes, traces, what)
    for column, colour, name in zip(shown.T, COLOURS, AXES, strict=True):
        axes.plot(times, column, color=colour, linewidth=1.3, label=name)
    length = np.sqrt(np.sum(shown * shown, axis=-1))
    axes.plot(times, length, color=INK, linewidth=1.1, linestyle="--", label="length")
    highest = float(length.max(initial=0.0))
    if limit <= 1.6 * highest:
        axes.axhline(limit, color=LIMIT, linewidth=1.2, linestyle=":", label="limit")
    else:
        axes.annotate(
            f"limit {limit:g}",
            (0.995, 0.97),
            xycoords="axes fraction",
            ha="right",
            va="top",
            fontsize=8,
            color=LIMIT,
        )


def _prepare(axes: Any, traces: Traces, what: str) -> None:  # noqa: ANN401 - Matplotlib has no types
    """Lay out a chart over time: grid, keyframes, lead-in and lead-out."""
    first, last = float(traces.keyframe_times[0]), float(traces.keyframe_times[-1])
    begin, end = float(traces.times[0]), float(traces.times[-1])
    for left, right in ((begin, first), (last, end)):
        if right > left:
            axes.axvspan(left, right, color=SHADE, linewidth=0)
    if len(traces.keyframe_times) <= 60:
        for time in traces.keyframe_times:
            axes.axvline(time, color="#bbbbbb", linewidth=0.7)
    axes.set_xlim(begin, end)
    axes.set_ylabel(what, fontsize=9, color=INK)
    axes.grid(axis="y", color=GRID, linewidth=0.6)
    axes.tick_params(labelsize=8, colors=INK)
    axes.spines[["top", "right"]].set_visible(False)


def _lateness(axes: Any, traces: Traces, timing: Timing) -> None:  # noqa: ANN401 - no types
    _prepare(axes, traces, "lateness, ms")
    step = max(1, len(timing.times) // MOST_POINTS)
    late = np.maximum(1e3 * timing.lateness, 1e-3)
    axes.scatter(timing.times[::step], late[::step], s=3, color=COLOURS[2], linewidth=0)
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
        other.plot(timing.times[::step], error[::step], color="#b9770e", linewidth=1.0)
        other.set_ylabel("tracking error, mrad", fontsize=9, color="#b9770e")
        other.tick_params(labelsize=8, colors="#b9770e")
        other.set_ylim(bottom=0.0)
        other.spines[["top", "left"]].set_visible(False)


def _histogram(axes: Any, timing: Timing) -> None:  # noqa: ANN401 - Matplotlib has no types
    late = np.maximum(1e3 * timing.lateness, 1e-3)
    lowest = float(late.min(initial=1e-2))
    bins = np.geomspace(0.8 * lowest, 1.25 * max(float(late.max(initial=0.0)), 0.1), 60)
    axes.hist(late, bins=bins, color=COLOURS[2], alpha=0.85)
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("lateness, ms", fontsize=9, color=INK)
    axes.set_ylabel("cycles", fontsize=9, color=INK)
    places = np.percentile(late, [50.0, 99.0, 99.9, 100.0]) if len(late) else np.zeros(4)
    names = ("p50", "p99", "p99.9", "max")
    for place, style in zip(places, ("-", "--", "-.", ":"), strict=True):
        axes.axvline(place, color=INK, linewidth=0.9, linestyle=style)
    axes.annotate(
        "\n".join(f"{name}  {place:.3f} ms" for name, place in zip(names, places, strict=True)),
        (0.98, 0.97),
        xycoords="axes fraction",
        ha="right",
        va="top",
        fontsize=9,
        color=INK,
        bbox={"facecolor": "white", "edgecolor": GRID},
    )
    axes.tick_params(labelsize=8, colors=INK)
    axes.grid(axis="y", color=GRID, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _save(figure: Any, path: Path) -> None:  # noqa: ANN401 - Matplotlib has no types
    try:
        figure.savefig(path, dpi=140)
    except OSError as error:
        raise OrientdError(f"cannot write {path}: {error.strerror}") from error
    except ValueError as error:
        raise OrientdError(f"cannot draw {path}: {str(error).splitlines()[0]}") from error
