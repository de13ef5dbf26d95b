"""Basis functions: what a curve is a sum of, and their cumulative forms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orientd.curves import cumulative_basis
from orientd.plots.paper import GRID, INK, SERIES, tidy
from orientd.rotation import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INSTANTS = 600


def cumulative_functions(knots: Floats, order: int, times: Floats) -> Floats:
    """Return every cumulative basis function at *times*, in rows.

    Args:
        knots: non-decreasing, shape ``(n + order,)``.
        order: degree plus one.
        times: inside the domain, ``knots[order - 1]`` to ``knots[-order]``.

    Returns:
        Shape ``(n, len(times))``; the first row is one throughout.
    """
    basis = cumulative_basis(knots, order)
    count = len(knots) - order
    span = np.searchsorted(basis.breaks[1:-1], times, side="right")
    varying = basis.at(span, times)[0]
    index = np.arange(count)[:, None]
    values: Floats = (index < basis.first[span]).astype(np.float64)
    for row, part in enumerate(varying):
        values[basis.first[span] + row, np.arange(len(times))] = part
    return values


def draw_functions(
    axes: Axes, times: Floats, functions: Floats, names: Sequence[str], *, marks: Floats
) -> None:
    """Draw functions over time, each with its name where it is highest or half way up.

    Args:
        axes: an empty chart.
        times: shape ``(n,)``.
        functions: in rows, shape ``(m, n)``.
        names: of the functions, in Matplotlib's notation.
        marks: instants marked by lines: the knots.
    """
    tidy(axes)
    for mark in np.unique(marks):
        axes.axvline(float(mark), color=GRID, linewidth=0.8, zorder=0.5)
    for number, (function, name) in enumerate(zip(functions, names, strict=True)):
        look = SERIES[number % len(SERIES)]
        axes.plot(
            times,
            function,
            color=look.colour,
            linestyle=look.stroke,
            linewidth=1.7,
            gid=f"basis-{number}",
        )
        rises = function[-1] > 0.999 and function[0] < 0.5
        place = int(np.argmax(function >= 0.5)) if rises else int(np.argmax(function))
        axes.annotate(
            name,
            (float(times[place]), float(function[place])),
            xytext=(7, -6) if rises else (0, 4),
            textcoords="offset points",
            ha="left" if rises else "center",
            va="center" if rises else "bottom",
            fontsize=10,
            color=look.colour,
        )
    axes.set_xlim(float(times[0]), float(times[-1]))
    axes.set_ylim(-0.03, 1.12 * float(functions.max()))
    axes.set_xlabel("t", fontsize=9, color=INK, style="italic")
