"""Triad traces: the paths of the tips of a body's three axes on the unit sphere.

Nielson (1993), Figs. 10 and 11, draws an orientation function so: what the three tips trace, the
samples numbered.  Hidden halves are paler and thinner here, and every axis has its own colour and
mark.  Keep-out cones show their edges, margins and names on the same sphere.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from orientd.keep_out import KeepOut
from orientd.plots.labels import enumeration, grouped, places
from orientd.plots.paper import AXES, GRID, INK, LIMIT, PAPER, QUIET, AxisStyle, Stroke
from orientd.plots.view import STANDARD_VIEW, Viewpoint
from orientd.rotation import Floats, angle, rotate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

MOST_NUMBERED = 16
"""Keyframes that are numbered one by one; of more, only some are."""

_AROUND = np.linspace(0.0, 2.0 * math.pi, 145)
"""Angles of the points of a cone's edge, rad."""


@dataclass(frozen=True, slots=True)
class TriadStyle:
    """How large and how detailed a sphere is drawn.

    Attributes:
        view: where the eye is.
        line: width of a trace in front, points.
        mark: diameter of a keyframe's mark, points.
        number: size of a keyframe's number, points; 0 for none.
        reach: half of the width of the chart, in radii of the sphere.
        step: from one drawn point of a trace to the next, degrees of turning.
    """

    view: Viewpoint = STANDARD_VIEW
    line: float = 2.0
    mark: float = 6.5
    number: float = 8.0
    reach: float = 1.13
    step: float = 0.75


SMALL = TriadStyle(line=1.3, mark=3.8, number=0.0, reach=1.05, step=2.0)
"""For a sphere among many."""


def draw_triads(
    axes: Axes,
    q: Floats,
    keyframe_q: Floats,
    *,
    style: TriadStyle = TriadStyle(),
    is_met: bool = True,
) -> None:
    """Draw the traces of the three axes with their keyframes on a chart of its own.

    Args:
        axes: an empty chart.
        q: orientations along the curve, body to world, shape ``(n, 4)``, close together.
        keyframe_q: the keyframes, shape ``(k, 4)``.
        style: how large and how detailed.
        is_met: whether the curve passes its keyframes; if not, the marks are hollow.
    """
    draw_sphere(axes, style)
    turned = [style.view.project(rotate(thinned(q, style.step), tip)) for tip in np.eye(3)]
    for axis, trace in zip(AXES, turned, strict=True):
        draw_trace(axes, trace, axis, style)
    marks = [style.view.project(rotate(keyframe_q, tip)) for tip in np.eye(3)]
    for axis, mark in zip(AXES, marks, strict=True):
        draw_marks(axes, mark, axis, style, is_met=is_met)
    if style.number > 0.0:
        _numbers(axes, np.stack(marks), np.concatenate(turned)[:, :2], style)


def thinned(q: Floats, step: float) -> Floats:
    """Return of the orientations *q* about one every *step* degrees, ``(m, 4)`` from ``(n, 4)``."""
    travelled = np.concatenate([[0.0], np.cumsum(angle(q[1:], q[:-1]))])
    wanted = np.arange(0.0, travelled[-1], np.radians(step))
    kept = np.unique(np.append(np.searchsorted(travelled, wanted), [0, len(q) - 1]))
    chosen: Floats = q[kept]
    return chosen


def draw_sphere(axes: Axes, style: TriadStyle) -> None:
    """Draw the sphere's outline, and its parallels and meridians in front, on all of a chart."""
    axes.set_xlim(-style.reach, style.reach)
    axes.set_ylim(-style.reach, style.reach)
    axes.set_aspect("equal")
    axes.set_axis_off()
    around = np.linspace(0.0, 2.0 * np.pi, 181)
    ring = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], axis=-1)
    axes.fill(ring[:, 0], ring[:, 1], facecolor="#fafafa", linewidth=0.0, zorder=0.2)
    axes.plot(ring[:, 0], ring[:, 1], color="#a8a8a8", linewidth=0.9, zorder=0.8)
    circles = [
        np.cos(height) * ring + np.array([0.0, 0.0, np.sin(height)])
        for height in np.radians([-60.0, -30.0, 0.0, 30.0, 60.0])
    ]
    for turn in np.radians(np.arange(0.0, 180.0, 30.0)):
        across = np.array([np.cos(turn), np.sin(turn), 0.0])
        circles.append(np.outer(ring[:, 0], across) + np.outer(ring[:, 1], [0.0, 0.0, 1.0]))
    for circle in circles:
        seen = style.view.project(circle)
        axes.plot(*part_of(seen, seen[:, 2] >= 0.0).T, color=GRID, linewidth=0.5, zorder=0.6)


def part_of(points: Floats, is_kept: NDArray[np.bool_]) -> Floats:
    """Return *points* on the sheet, interrupted where they are not kept."""
    # One more at each end of a run, so that halves meet.
    wide = is_kept.copy()
    wide[1:] |= is_kept[:-1]
    shown: Floats = np.where(wide[:, None], points[:, :2], np.nan)
    return shown


def draw_trace(
    axes: Axes, points: Floats, axis: AxisStyle, style: TriadStyle, stroke: Stroke = "-"
) -> None:
    """Draw the path of a tip, from :meth:`.Viewpoint.project`, paler and thinner where hidden."""
    is_front = points[:, 2] >= 0.0
    behind = axes.plot(
        *part_of(points, ~is_front).T, color=axis.subdued, linewidth=0.55 * style.line, zorder=1.0
    )
    front = part_of(points, is_front)
    # A rim of paper parts lines that cross.
    axes.plot(*front.T, color=PAPER, linewidth=style.line + 1.4, zorder=2.0)
    before = axes.plot(
        *front.T,
        color=axis.colour,
        linewidth=style.line,
        linestyle=stroke,
        zorder=2.0,
        solid_capstyle="round",
    )
    behind[0].set_gid(f"hidden-{axis.name}")
    before[0].set_gid(f"trace-{axis.name}")


def draw_marks(
    axes: Axes, points: Floats, axis: AxisStyle, style: TriadStyle, *, is_met: bool
) -> None:
    """Draw keyframes of a tip, from :meth:`.Viewpoint.project`, hollow unless they are met."""
    for is_shown, colour, order in (
        (points[:, 2] < 0.0, axis.subdued, 1.5),
        (points[:, 2] >= 0.0, axis.colour, 3.0),
    ):
        lines = axes.plot(
            *points[is_shown, :2].T,
            linestyle="",
            marker=axis.mark,
            markersize=style.mark,
            markerfacecolor=colour if is_met else PAPER,
            markeredgecolor=PAPER if is_met else colour,
            markeredgewidth=0.14 * style.mark,
            zorder=order,
        )
        lines[0].set_gid(f"keyframes-{axis.name}")


def _numbers(axes: Axes, marks: Floats, traces: Floats, style: TriadStyle) -> None:
    """Number the keyframes at every axis; the first of each is led by the axis's letter.

    Args:
        axes: the chart.
        marks: the keyframes of each axis, shape ``(3, k, 3)``.
        traces: points of the traces, shape ``(m, 2)``.
        style: the size of the numbers.
    """
    every = -(-marks.shape[1] // MOST_NUMBERED)
    # The sheet measures in radii of the sphere, a text in points: this much of one a point.
    unit = 2.0 * style.reach / _width_in_points(axes)
    texts: list[tuple[str, Floats, AxisStyle]] = []
    for axis, points in zip(AXES, marks, strict=True):
        # Points in front never share a label with points behind.
        lifted = points[:, :2] + np.where(points[:, 2] >= 0.0, 0.0, 100.0)[:, None]
        for group in grouped(lifted, 0.75 * style.number * unit):
            numbers = [k + 1 for k in group if k % every == 0 or k == marks.shape[1] - 1]
            if numbers:
                letter = axis.name if numbers[0] == 1 else ""
                texts.append((letter + enumeration(numbers), points[group[0]], axis))
    anchors = np.array([point[:2] for _, point, _ in texts])
    sizes = np.array([[0.66 * len(text) + 0.1, 1.1] for text, _, _ in texts])
    obstacles = np.concatenate([traces, np.repeat(marks[..., :2].reshape(-1, 2), 4, axis=0)])
    centres = places(
        anchors, sizes * style.number * unit, obstacles, gap=(0.55 * style.mark + 0.5) * unit
    )
    for (text, point, axis), centre in zip(texts, centres, strict=True):
        if not np.isfinite(centre[0]):
            continue
        is_first = text.startswith(axis.name)
        written = axes.text(
            float(centre[0]),
            float(centre[1]),
            text,
            fontsize=style.number + (1.5 if is_first else 0.0),
            fontweight="bold" if is_first else "normal",
            color=axis.colour if is_first else INK if point[2] >= 0.0 else QUIET,
            ha="center",
            va="center",
            zorder=4.0,
        )
        _rimmed(written)
        written.set_gid(f"number-{axis.name}-{text}")


def _rimmed(text: Text) -> None:
    """Give a text a rim of paper, so that it can be read across a line."""
    from matplotlib.patheffects import withStroke

    text.set_path_effects([withStroke(linewidth=2.0, foreground=PAPER)])


def _width_in_points(axes: Axes) -> float:
    """Return about how wide a chart will be, before the layout is known."""
    figure = axes.get_figure()
    dots = min(axes.bbox.width, axes.bbox.height)
    return float(72.0 * dots / (figure.dpi if figure is not None else 100.0))


def turned_to_show(q: Floats, style: TriadStyle, keep_out: Sequence[KeepOut] = ()) -> TriadStyle:
    """Return *style* seen from where the most of the traces of *q* is in front.

    With cones, only the traces of the axes that stay out of them count.
    """
    axes = np.array([cone.axis for cone in keep_out]) if keep_out else np.eye(3)
    tips = np.concatenate([rotate(thinned(q, style.step), tip) for tip in axes])
    views = [Viewpoint(style.view.elevation, float(azimuth)) for azimuth in range(0, 360, 15)]
    seen = [np.count_nonzero(view.project(tips)[:, 2] > 0.0) for view in views]
    return replace(style, view=views[int(np.argmax(seen))])


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
