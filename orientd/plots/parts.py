"""Pictures of one aspect of a curve: its triad traces, its rates, the body it moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orientd.plots.bodies import SweptPoses, draw_bodies, plate
from orientd.plots.charts import Traces, draw_acceleration, draw_velocity
from orientd.plots.paper import check_format, new_figure, save
from orientd.plots.triads import TriadStyle, draw_triads, turned_to_show
from orientd.plots.view import Viewpoint
from orientd.rotation import Floats

BODIES = 40
"""Poses at which the body is drawn light, evenly spaced in time."""

BODY_SHARE = 0.09
"""Half of the width of the body, as a share of the extent of its path."""


def draw_triads_alone(path: Path, traces: Traces, *, title: str) -> None:
    """Draw the triad traces of a curve to *path*, seen from where the most of them is in front.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(7.0, 7.2, title)
    style = turned_to_show(traces.q, TriadStyle(number=9.0))
    draw_triads(figure.subplots(), traces.q, traces.keyframe_q, style=style, is_met=traces.is_met)
    save(figure, path)


def draw_rates_alone(path: Path, traces: Traces, *, title: str) -> None:
    """Draw angular velocity and acceleration of a curve to *path*.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(9.0, 6.0, title)
    upper, lower = figure.subplots(2, 1)
    draw_velocity(upper, traces)
    draw_acceleration(lower, traces)
    lower.set_xlabel("time, s", fontsize=9)
    save(figure, path)


def draw_bodies_alone(path: Path, traces: Traces, positions: Floats, *, title: str) -> None:
    """Draw a plate along a rigid motion to *path*, dark at the keyframes.

    Args:
        path: its ending names the format.
        traces: the orientations.
        positions: m, at the same instants, shape ``(n, 3)``, not all the same.
        title: stands above.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    size = BODY_SHARE * float(np.max(np.ptp(positions, axis=0)))
    faces = [size * face for face in plate()]
    evenly = np.linspace(traces.times[0], traces.times[-1], BODIES + 1)[:-1]
    evenly += 0.5 * (evenly[1] - evenly[0])
    between, met = (
        np.clip(np.searchsorted(traces.times, instants), 0, len(traces.times) - 1)
        for instants in (evenly, traces.keyframe_times)
    )
    figure = new_figure(9.0, 6.0, title)
    draw_bodies(
        figure.subplots(),
        faces,
        SweptPoses(positions[between], traces.q[between]),
        SweptPoses(positions[met], traces.q[met]),
        _across(positions),
        positions,
    )
    save(figure, path)


def _across(positions: Floats) -> Viewpoint:
    """Return the view that sees the most of a path's width."""
    views = [Viewpoint(24.0, float(azimuth)) for azimuth in range(-90, 90, 10)]
    widths = [np.ptp(view.project(positions)[:, 0]) for view in views]
    return views[int(np.argmax(widths))]
