"""Pictures of one curve, or motion: as it is planned, by itself, and as it was sent."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orientd.curves.contract import Curve
from orientd.curves.keyframes import check_keys, resolve_times
from orientd.curves.roles import CurveTask
from orientd.plots.charts import Traces, draw_acceleration, draw_velocity
from orientd.plots.paper import INK, QUIET, check_format, new_figure, save
from orientd.plots.punctuality import Timing, draw_histogram, draw_lateness
from orientd.plots.sampling import traces_of, traces_of_motion
from orientd.plots.triads import TriadStyle, draw_cones, draw_triads, turned_to_show
from orientd.rotation import align

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from orientd.planner.motion import Motion

Charts = dict[str, "Axes"]

_DPI = 80
"""Of a picture in a notebook."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture that a notebook displays.

    Attributes:
        png: the bytes of a PNG file.
    """

    png: bytes

    def _repr_png_(self) -> bytes:
        return self.png


def draw(shown: Curve | Motion, path: str | Path, *, title: str = "") -> None:
    """Draw a curve or a motion to a file: orientations, angular velocity and acceleration.

    Args:
        shown: the curve or the motion.
        path: the file; it ends in .png, .svg or .pdf.
        title: above the picture; by default the name of the method.

    Raises:
        OrientdError: the file cannot be written, its ending names no format of a picture, or
            Matplotlib is not installed.
    """
    draw_traces(Path(path), _traces(shown), title=title or _title(shown))


def picture(shown: Curve | Motion, *, title: str = "") -> Picture:
    """Return the picture of a curve or a motion for a notebook; otherwise like :func:`draw`.

    Raises:
        OrientdError: Matplotlib is not installed.
    """
    figure = figure_of(_traces(shown), title=title or _title(shown))
    png = BytesIO()
    save(figure, png, dpi=_DPI)
    return Picture(png.getvalue())


def _traces(shown: Curve | Motion) -> Traces:
    if isinstance(shown, Curve):
        return traces_of(shown, _task(shown))
    return traces_of_motion(shown)


def _title(shown: Curve | Motion) -> str:
    if isinstance(shown, Curve):
        return getattr(shown, "name", type(shown).__name__)
    return f"{shown.request.method}: motion {shown.id}"


def _task(curve: Curve) -> CurveTask:
    """Return the keyframes that a curve was made of, or its ends where it knows none."""
    made = curve.made_of
    if "keys" in made:
        keys = check_keys(made["keys"])
        if made.get("align", True):
            keys = align(keys)
        return CurveTask(keys, resolve_times(made.get("times"), keys, made.get("turns")))
    if "control" in made:
        keys = check_keys(made["control"])
        return CurveTask(keys, np.linspace(*curve.domain, len(keys)))
    ends = np.array(curve.domain)
    return CurveTask(curve.evaluate(ends)[0], ends)


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
    style = turned_to_show(traces.q, TriadStyle(), traces.keep_out)
    draw_triads(charts["sphere"], traces.q, traces.keyframe_q, style=style, is_met=traces.is_met)
    draw_cones(charts["sphere"], traces.keep_out, style)
    marks = "dots are keyframes" if traces.is_met else "hollow marks are control orientations"
    charts["sphere"].set_title(
        f"the tool's axes on the unit sphere; {marks}", fontsize=9, color=INK, y=-0.06
    )
    draw_velocity(charts["velocity"], traces)
    draw_acceleration(charts["acceleration"], traces)
