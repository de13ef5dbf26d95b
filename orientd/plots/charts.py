"""Charts over time: angular velocity and acceleration, their limits, keyframes and leads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from orientd.keep_out import KeepOut
from orientd.plots.paper import AXES, INK, LIMIT, QUIET, SHADE, tidy
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_POINTS = 4000
"""Points in one line of a chart; more cannot be seen."""

MOST_KEYFRAMES = 60
"""Keyframes that are marked; of more, only a grey wall would be left."""

NEAR = 1.6
"""A limit is drawn where the curve comes this near to it; else it would flatten the curve."""


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Hold the curves of a motion that a picture shows.

    Attributes:
        times: s, shape ``(n,)``.
        q: orientations, tool to world, shape ``(n, 4)``.
        omega_body: rad/s, shape ``(n, 3)``.
        alpha_body: rad/s^2, shape ``(n, 3)``.
        keyframe_times: s.
        keyframe_q: orientations of the keyframes, shape ``(k, 4)``.
        velocity_limit: rad/s; infinite if there is none.
        acceleration_limit: rad/s^2; infinite if there is none.
        breaks: instants at which velocity or acceleration may jump, s; lines are interrupted there.
        is_met: whether the curve passes its keyframes.
        keep_out: cones that the motion stays out of, each with a fixed direction.
    """

    times: Floats
    q: Floats
    omega_body: Floats
    alpha_body: Floats
    keyframe_times: Floats
    keyframe_q: Floats
    velocity_limit: float = np.inf
    acceleration_limit: float = np.inf
    breaks: Floats | None = None
    is_met: bool = True
    keep_out: Sequence[KeepOut] = ()


def draw_velocity(axes: Axes, traces: Traces) -> None:
    """Draw the components and the length of the angular velocity in the body frame."""
    _components(
        axes, traces, traces.omega_body, "angular velocity, rad/s", traces.velocity_limit, "rad/s"
    )
    lines, names = axes.get_legend_handles_labels()
    axes.legend(
        [*lines[1:], lines[0]],
        [*names[1:], names[0]],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.03),
        ncols=5,
        frameon=False,
        fontsize=9,
        handlelength=3.2,
    )


def draw_acceleration(axes: Axes, traces: Traces) -> None:
    """Draw the components and the length of the angular acceleration in the body frame."""
    what, unit = "angular acceleration, rad/s²", "rad/s²"
    _components(axes, traces, traces.alpha_body, what, traces.acceleration_limit, unit)


def mark_keyframes(axes: Axes, traces: Traces, *, is_numbered: bool = False) -> None:
    """Mark the instants of the keyframes, and shade what lies before the first and after the last.

    Args:
        axes: a chart over time.
        traces: the motion.
        is_numbered: whether numbers stand above the chart.
    """
    first, last = float(traces.keyframe_times[0]), float(traces.keyframe_times[-1])
    begin, end = float(traces.times[0]), float(traces.times[-1])
    for left, right in ((begin, first), (last, end)):
        if right > left:
            axes.axvspan(left, right, color=SHADE, linewidth=0, zorder=0.1)
    axes.set_xlim(begin, end)
    if len(traces.keyframe_times) > MOST_KEYFRAMES:
        return
    least, written = 0.03 * (end - begin), -np.inf
    for number, time in enumerate(traces.keyframe_times.tolist(), start=1):
        axes.axvline(time, color="#bbbbbb", linewidth=0.7, zorder=0.5)
        if is_numbered and time - written >= least:
            axes.annotate(
                str(number),
                (time, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(0, 1),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=7.5,
                color=QUIET,
            )
            written = time


def interrupted(times: Floats, values: Floats, breaks: Floats | None) -> tuple[Floats, Floats]:
    """Return *times* and *values* with a gap where a jump lies between two samples.

    Args:
        times: increasing, shape ``(n,)``.
        values: shape ``(n, m)``.
        breaks: instants of the jumps, or ``None``.
    """
    if breaks is None or not len(breaks):
        return times, values
    gaps = np.unique(np.searchsorted(times, breaks))
    gaps = gaps[(gaps > 0) & (gaps < len(times))]
    return np.insert(times, gaps, times[gaps]), np.insert(values, gaps, np.nan, axis=0)


def draw_limit(axes: Axes, limit: float, highest: float, unit: str) -> None:
    """Draw a limit on the length of a vector, or say where it lies if that is far above."""
    if not np.isfinite(limit):
        return
    if limit <= NEAR * highest:
        line = axes.axhline(limit, color=LIMIT, linewidth=1.3, linestyle=(0.0, (1.5, 1.5)))
        line.set_gid("limit")
        place, where, upright = (1.0, limit), ("axes fraction", "data"), "bottom"
        axes.set_ylim(top=max(axes.get_ylim()[1], 1.12 * limit))
    else:
        place, where, upright = (1.0, 1.0), ("axes fraction", "axes fraction"), "top"
    written = axes.annotate(
        f"limit {limit:g} {unit}",
        place,
        xycoords=where,
        xytext=(-3, 1 if upright == "bottom" else -2),
        textcoords="offset points",
        ha="right",
        va=upright,
        fontsize=8,
        color=LIMIT,
    )
    written.set_gid("limit-text")


def _components(
    axes: Axes, traces: Traces, vectors: Floats, what: str, limit: float, unit: str
) -> None:
    step = max(1, len(vectors) // MOST_POINTS)
    tidy(axes, what)
    mark_keyframes(axes, traces, is_numbered=True)
    times, shown = interrupted(traces.times[::step], vectors[::step], traces.breaks)
    length = np.sqrt(np.sum(shown * shown, axis=-1))
    axes.plot(times, length, color="#9a9a9a", linewidth=2.6, label="length", zorder=2.0)
    for column, axis in zip(shown.T, AXES, strict=True):
        axes.plot(
            times,
            column,
            color=axis.colour,
            linestyle=axis.stroke,
            linewidth=1.5,
            label=axis.name,
            zorder=2.5,
            gid=f"component-{axis.name}",
        )
    axes.axhline(0.0, color=INK, linewidth=0.6, zorder=1.0)
    draw_limit(axes, limit, float(np.nanmax(length, initial=0.0)), unit)
