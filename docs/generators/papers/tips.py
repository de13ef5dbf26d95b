"""Traces that only figures of the papers show: of one tip by several motions, and of an ideal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orientd.plots.paper import AXES, AxisStyle
from orientd.plots.triads import (
    TriadStyle,
    draw_marks,
    draw_sphere,
    draw_trace,
    part_of,
    thinned,
)
from orientd.rotation import Floats, rotate

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_tip_paths(
    axes: Axes, paths: Sequence[tuple[Floats, AxisStyle]], tip: Floats, *, style: TriadStyle
) -> None:
    """Draw what one tip of a body traces under several motions, each in a style of its own.

    Args:
        axes: an empty chart.
        paths: orientations, shape ``(n, 4)``, with the style of each, whose name is its label.
        tip: in the body's frame, shape ``(3,)``.
        style: how large and how detailed.
    """
    draw_sphere(axes, style)
    for q, look in paths:
        points = style.view.project(rotate(thinned(q, style.step), tip))
        draw_trace(axes, points, look, style, look.stroke)
        draw_marks(axes, points[[0, -1]], look, style, is_met=True)
        axes.plot(
            [], [], color=look.colour, linewidth=style.line, linestyle=look.stroke, label=look.name
        )


def draw_ideal(axes: Axes, ideal: Floats, style: TriadStyle) -> None:
    """Draw the traces of a curve to compare with, dotted, on a chart of triad traces.

    Args:
        axes: the chart.
        ideal: orientations along the curve, shape ``(m, 4)``.
        style: of the chart.
    """
    for axis, tip in zip(AXES, np.eye(3), strict=True):
        points = style.view.project(rotate(thinned(ideal, style.step), tip))
        is_front = points[:, 2] >= 0.0
        for is_shown, colour, order in (
            (~is_front, axis.subdued, 0.9),
            (is_front, axis.colour, 2.5),
        ):
            lines = axes.plot(
                *part_of(points, is_shown).T,
                color=colour,
                linewidth=0.65 * style.line,
                linestyle=(0.0, (1.0, 1.8)),
                zorder=order,
            )
            lines[0].set_gid(f"ideal-{axis.name}")
