"""Pictures of one motion: as it is planned, and as it was sent."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orientd.plots.charts import MOST_POINTS, Traces, draw_acceleration, draw_velocity
from orientd.plots.paper import INK, QUIET, check_format, new_figure, save
from orientd.plots.punctuality import Timing, draw_histogram, draw_lateness
from orientd.plots.triads import TriadStyle, draw_triads, turned_to_show

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from orientd.planner import Motion

Charts = dict[str, "Axes"]


def draw_motion(path: Path, motion: Motion, *, title: str) -> None:
    """Draw a planned motion to *path*, whose ending names the format.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    draw_traces(path, traces_of_motion(motion), title=title)


def traces_of_motion(motion: Motion) -> Traces:
    """Return what there is to draw of a planned motion."""
    times = np.linspace(0.0, motion.duration, MOST_POINTS)
    samples = motion.sample(times)
    return Traces(
        times=times,
        q=samples.q,
        omega_body=samples.omega_body,
        alpha_body=samples.alpha_body,
        keyframe_times=motion.keyframe_times,
        keyframe_q=motion.request.keys,
        velocity_limit=motion.limits.velocity,
        acceleration_limit=motion.limits.acceleration,
    )


def draw_traces(path: Path, traces: Traces, *, title: str, note: str = "") -> None:
    """Draw a curve to *path*: triad traces, angular velocity and acceleration.

    Args:
        path: its ending names the format.
        traces: what to draw.
        title: stands above.
        note: stands below.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    save(figure_of(traces, title=title, note=note), path)


def figure_of(traces: Traces, *, title: str, note: str = "") -> Figure:
    """Return the figure of a curve; see :func:`draw_traces`."""
    figure = new_figure(12.0, 6.3, title)
    charts: Charts = figure.subplot_mosaic(
        [["sphere", "velocity"], ["sphere", "acceleration"]], width_ratios=[1.0, 1.2]
    )
    _fill(charts, traces)
    charts["acceleration"].set_xlabel("time, s", fontsize=9)
    if note:
        figure.supxlabel(note, x=0.012, ha="left", fontsize=8.5, color=QUIET)
    return figure


def draw_sent(path: Path, traces: Traces, timing: Timing, *, title: str) -> None:
    """Draw what was sent of a motion, and how punctually, to *path*.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(13.0, 9.0, title)
    charts: Charts = figure.subplot_mosaic(
        [["sphere", "velocity"], ["sphere", "acceleration"], ["histogram", "lateness"]],
        width_ratios=[1.0, 1.25],
    )
    _fill(charts, traces)
    draw_lateness(charts["lateness"], traces, timing)
    draw_histogram(charts["histogram"], timing)
    charts["lateness"].set_xlabel("time, s", fontsize=9)
    save(figure, path)


def _fill(charts: Charts, traces: Traces) -> None:
    style = turned_to_show(traces.q, TriadStyle())
    draw_triads(charts["sphere"], traces.q, traces.keyframe_q, style=style, is_met=traces.is_met)
    marks = "dots are keyframes" if traces.is_met else "hollow marks are control orientations"
    charts["sphere"].set_title(
        f"the tool's axes on the unit sphere; {marks}", fontsize=9, color=INK, y=-0.06
    )
    draw_velocity(charts["velocity"], traces)
    draw_acceleration(charts["acceleration"], traces)
