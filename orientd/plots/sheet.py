"""The sheet of all families side by side: triad traces, rates, and their figures."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orientd.curves.comparison import Candidate, Figures
from orientd.curves.roles import CurveTask
from orientd.model.limits import Limits
from orientd.plots.charts import Traces, interrupted
from orientd.plots.paper import AXES, GRID, INK, LIMIT, PAPER, QUIET, check_format, new_figure, save
from orientd.plots.sampling import traces_of
from orientd.plots.triads import SMALL, draw_triads, turned_to_show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Boxes = Callable[[float, float, float], tuple[float, float, float, float]]
"""Returns the box of a chart of a family by the inches of its bottom, width and height."""

CELL_WIDTH, CELL_HEIGHT = 2.45, 3.85
HEAD, FOOT, LINE = 1.0, 0.55, 0.17
"""Inches: one family, what stands above all of them, below, and one line of text."""

REFERENCE = "#c9c9c9"

HEADROOM = 2.0
"""A strip reaches this many medians of the families' peaks; what is higher is cut off."""

INSTANTS = 400


def draw_sheet(
    path: Path,
    task: CurveTask,
    candidates: Sequence[Candidate],
    *,
    title: str,
    limits: Limits | None = None,
) -> None:
    """Draw every family that applies, in the order given, and say why the others do not.

    Each has its triad traces and the lengths of angular velocity and acceleration, over those of
    the first family in grey.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    drawn = [
        (candidate, candidate.figures, traces_of(curve, task, limits=limits, instants=INSTANTS))
        for candidate in candidates
        if (curve := candidate.curve) is not None and candidate.figures is not None
    ]
    columns = _columns(len(drawn))
    footer = _footer(candidates, columns=columns)
    rows = -(-len(drawn) // columns)
    width = columns * CELL_WIDTH + 0.45
    height = rows * CELL_HEIGHT + HEAD + FOOT + LINE * len(footer)
    figure = new_figure(width, height, is_laid_out=False)
    figure.text(0.15 / width, 1.0 - 0.3 / height, title, fontsize=14, fontweight="bold", color=INK)
    figure.text(
        0.15 / width,
        1.0 - 0.55 / height,
        "Where the tips of the body's axes go on the unit sphere; hollow marks: keyframes that the "
        "curve does not meet.\nBelow, lengths of angular velocity and acceleration; grey: the "
        "first family.  Effort: the integral of the squared acceleration; * but the velocity jumps "
        "at a keyframe.",
        fontsize=8.5,
        color=QUIET,
        va="top",
        linespacing=1.4,
    )
    _legend(figure)
    style = turned_to_show(drawn[0][2].q, SMALL) if drawn else SMALL
    tops = _tops([traces for _, _, traces in drawn])
    for place, (candidate, figures, traces) in enumerate(drawn):
        row, column = divmod(place, columns)
        corner = (
            0.45 + column * CELL_WIDTH,
            height - HEAD - (row + 1) * CELL_HEIGHT,
        )
        box = partial(_box, corner, (width, height))
        _write_headline(figure, box, candidate.name, place + 1, figures)
        side = CELL_WIDTH - 0.3
        axes = figure.add_axes(box(CELL_HEIGHT - 0.42 - side, side, side))
        draw_triads(axes, traces.q, traces.keyframe_q, style=style, is_met=traces.is_met)
        _draw_strips(figure, box, traces, drawn[0][2], tops, is_first=column == 0)
    for number, line in enumerate(footer):
        figure.text(
            0.15 / width,
            (FOOT - 0.25 + LINE * (len(footer) - 1 - number)) / height,
            line,
            fontsize=8,
            color=QUIET,
        )
    save(figure, path, dpi=110)


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D

    figure.legend(
        handles=[
            Line2D([], [], color=axis.colour, marker=axis.mark, markersize=5, label=axis.name)
            for axis in AXES
        ],
        loc="upper right",
        ncols=3,
        frameon=False,
        fontsize=9,
    )


def _columns(count: int) -> int:
    """Return the number of columns that leaves the fewest places empty."""
    if count <= 4:
        return max(count, 1)
    return min((6, 5, 4), key=lambda columns: -count % columns)


def _tops(drawn: Sequence[Traces]) -> tuple[float, float]:
    """Return the tops of the strips of velocity and acceleration."""
    found = []
    for name in ("omega_body", "alpha_body"):
        peaks = [float(np.linalg.norm(getattr(traces, name), axis=-1).max()) for traces in drawn]
        middle = float(np.median(peaks)) if peaks else 1.0
        within = [peak for peak in peaks if peak <= HEADROOM * middle]
        found.append(1.08 * max(within, default=1.0) or 1.0)
    return found[0], found[1]


def _footer(candidates: Sequence[Candidate], *, columns: int) -> list[str]:
    lines: list[str] = []
    for candidate in candidates:
        if candidate.curve is None:
            text = f"not drawn: {candidate.name} ({candidate.why_not})"
            lines += textwrap.wrap(text, 42 * columns, subsequent_indent="      ")
    return lines


def _box(
    corner: tuple[float, float],
    sheet: tuple[float, float],
    bottom: float,
    width: float,
    height: float,
) -> tuple[float, float, float, float]:
    """Return the box of a chart, which is *bottom* inches above the corner of its family."""
    across, up = sheet
    x, y = corner
    return x / across, (y + bottom) / up, width / across, height / up


def _write_headline(figure: Figure, box: Boxes, name: str, place: int, figures: Figures) -> None:
    """Write place, name and figures of a family above it."""
    x, y, _, _ = box(CELL_HEIGHT - 0.2, 0.0, 0.0)
    title = figure.text(x, y, f"{place}  {name}", fontsize=9.5, fontweight="bold", color=INK)
    title.set_gid(f"family-{name}")
    infinite = "*" if figures.has_velocity_jumps else ""
    missed = "" if figures.interpolates else f", off {np.degrees(figures.keyframe_error):.0f}°"
    x, y, _, _ = box(CELL_HEIGHT - 0.37, 0.0, 0.0)
    text = f"C{figures.continuity}{missed}, effort {figures.effort:.4g}{infinite}"
    figure.text(x, y, text, fontsize=8, color=QUIET)


def _draw_strips(
    figure: Figure,
    box: Boxes,
    traces: Traces,
    reference: Traces,
    tops: tuple[float, float],
    *,
    is_first: bool,
) -> None:
    """Draw the lengths of velocity and acceleration."""
    for bottom, name, limit, top, unit in (
        (0.74, "omega_body", traces.velocity_limit, tops[0], "rad/s"),
        (0.24, "alpha_body", traces.acceleration_limit, tops[1], "rad/s²"),
    ):
        axes = figure.add_axes(box(bottom, CELL_WIDTH - 0.35, 0.42))
        behind = np.linalg.norm(getattr(reference, name), axis=-1)
        axes.fill_between(reference.times, behind, color=REFERENCE, linewidth=0.0)
        times, vectors = interrupted(traces.times, getattr(traces, name), traces.breaks)
        lengths = np.linalg.norm(vectors, axis=-1)
        axes.plot(times, lengths, color=INK, linewidth=0.9)
        if limit <= top:
            axes.axhline(limit, color=LIMIT, linewidth=0.9, linestyle=(0.0, (1.5, 1.5)))
        peak = float(np.nanmax(lengths))
        if peak > top:
            axes.annotate(
                f"up to {peak:.3g}",
                (0.99, 0.97),
                xycoords="axes fraction",
                ha="right",
                va="top",
                fontsize=6.5,
                color=INK,
                bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 0.8},
            )
        axes.set_xlim(float(traces.times[0]), float(traces.times[-1]))
        axes.set_ylim(0.0, top)
        for time in traces.keyframe_times if len(traces.keyframe_times) <= 60 else ():
            axes.axvline(float(time), color=GRID, linewidth=0.5, zorder=0.5)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=6.5, colors=INK, length=2.0, pad=1.5)
        axes.locator_params(axis="y", nbins=2)
        if bottom > 0.5:
            axes.set_xticklabels([])
        if is_first:
            axes.set_ylabel(unit, fontsize=7, color=INK, labelpad=2.0)
        else:
            axes.set_yticklabels([])
