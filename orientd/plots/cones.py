"""Keep-out cones on the sphere of the tool's axes: their edges, margins and names."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orientd.keep_out import KeepOut
from orientd.plots.paper import LIMIT
from orientd.plots.triads import TriadStyle
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AROUND = np.linspace(0.0, 2.0 * math.pi, 145)


def draw_cones(axes: Axes, keep_out: Sequence[KeepOut], style: TriadStyle) -> None:
    """Draw cones on a sphere of traces, each around its direction.

    Args:
        axes: the chart with the sphere.
        keep_out: each with a fixed direction.
        style: of the sphere.
    """
    for cone in keep_out:
        direction = np.array(cone.direction_at(0))
        edge = style.view.project(_circle(direction, cone.half_angle))
        is_front = edge[:, 2] >= 0.0
        axes.fill(*edge[:, :2].T, color=LIMIT, alpha=0.16 if is_front.any() else 0.05, zorder=0.9)
        for is_shown, width in ((is_front, 1.4), (~is_front, 0.6)):
            x, y = np.where(is_shown[:, None], edge[:, :2], np.nan).T
            (line,) = axes.plot(x, y, color=LIMIT, linewidth=width, zorder=1.8)
            line.set_gid(f"keep-out-{cone.name}")
        if cone.margin:
            margin = style.view.project(_circle(direction, cone.half_angle + cone.margin))
            x, y = np.where(margin[:, 2:] >= 0.0, margin[:, :2], np.nan).T
            axes.plot(x, y, color=LIMIT, linewidth=0.8, linestyle=(0.0, (3.0, 2.0)), zorder=1.8)
        right, up, _ = style.view.project(direction)
        axes.text(
            right, up, cone.name, color=LIMIT, fontsize=8.5, ha="center", va="center", zorder=4.0
        )


def _circle(direction: Floats, radius: float) -> Floats:
    """Return points of a circle around a direction on the unit sphere, shape ``(n, 3)``."""
    across = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    across /= np.linalg.norm(across)
    other = np.cross(direction, across)
    ring = np.cos(_AROUND)[:, None] * across + np.sin(_AROUND)[:, None] * other
    found: Floats = math.cos(radius) * direction + math.sin(radius) * ring
    return found
