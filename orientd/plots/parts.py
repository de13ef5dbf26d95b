"""Pictures of one aspect of a curve: its triad traces, its rates, the body it moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from orientd.plots.bodies import SweptPoses, draw_bodies, plate
from orientd.plots.charts import Traces, draw_acceleration, draw_velocity
from orientd.plots.paper import check_format, new_figure, save
from orientd.plots.triads import TriadStyle, draw_triads, turned_to_show
from orientd.plots.view import Viewpoint
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Part = Literal["triads", "rates", "body"]
_SIZES = {"triads": (7.0, 7.2), "rates": (9.0, 6.0), "body": (9.0, 6.0)}
"""Width and height of each picture, inches."""

BODIES = 40
"""Poses at which the body is drawn light, evenly spaced in time."""

BODY_SHARE = 0.09
"""Half of the width of the body, as a share of the extent of its path."""


def draw_part(
    path: Path, traces: Traces, part: Part, *, title: str, positions: Floats | None = None
) -> None:
    """Draw one aspect of a curve to *path*.

    Args:
        path: its ending names the format.
        traces: the curve.
        part: the triad traces, seen from where the most of them is in front; angular velocity and
            acceleration; or a plate that moves along the curve, dark at the keyframes.
        title: stands above.
        positions: of the plate, m, at the instants of the traces, shape ``(n, 3)``, not all the
            same; only for the body.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
        ValueError: a body has no positions.
    """
    check_format(path)
    figure = new_figure(*_SIZES[part], title)
    if part == "triads":
        style = turned_to_show(traces.q, TriadStyle(number=9.0))
        axes = figure.subplots()
        draw_triads(axes, traces.q, traces.keyframe_q, style=style, is_met=traces.is_met)
    elif part == "rates":
        upper, lower = figure.subplots(2, 1)
        draw_velocity(upper, traces)
        draw_acceleration(lower, traces)
        lower.set_xlabel("time, s", fontsize=9)
    elif positions is None:
        raise ValueError("expected the positions of the body, got none")
    else:
        _draw_body(figure.subplots(), traces, positions)
    save(figure, path)


def _draw_body(axes: Axes, traces: Traces, positions: Floats) -> None:
    size = BODY_SHARE * float(np.max(np.ptp(positions, axis=0)))
    faces = [size * face for face in plate()]
    evenly = np.linspace(traces.times[0], traces.times[-1], BODIES + 1)[:-1]
    evenly += 0.5 * (evenly[1] - evenly[0])
    between, met = (
        SweptPoses(positions[at], traces.q[at])
        for instants in (evenly, traces.keyframe_times)
        for at in [np.clip(np.searchsorted(traces.times, instants), 0, len(traces.times) - 1)]
    )
    draw_bodies(axes, faces, between, met, _across(positions), positions)


def _across(positions: Floats) -> Viewpoint:
    """Return the view that sees the most of a path's width."""
    views = [Viewpoint(24.0, float(azimuth)) for azimuth in range(-90, 90, 10)]
    widths = [np.ptp(view.project(positions)[:, 0]) for view in views]
    return views[int(np.argmax(widths))]
