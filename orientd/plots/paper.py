"""The sheet that pictures are drawn on: colours, strokes, figures, files.

Three colours stand for the three axes of a body everywhere.  They differ in lightness as well as in
hue, so they stay distinct for colour-blind readers and in grey print.  Each has its own stroke and
mark.  The first figure imports Matplotlib.  This module opens no window and changes no global
state.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from orientd.errors import OrientdError
from orientd.files import written

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#222222"
QUIET = "#767676"
GRID = "#dddddd"
LIMIT = "#7d3c98"
SHADE = "#f1eee6"
PAPER = "#ffffff"

Stroke = str | tuple[float, Sequence[float]]


@dataclass(frozen=True, slots=True)
class AxisStyle:
    """How one axis of a body is drawn.

    Attributes:
        name: its letter.
        colour: of lines and marks.
        subdued: the same where it is hidden behind the sphere.
        stroke: of its component in a chart, in Matplotlib's terms.
        mark: of its keyframes, in Matplotlib's terms.
    """

    name: str
    colour: str
    subdued: str
    stroke: Stroke
    mark: str


AXES = (
    AxisStyle("x", "#c03a17", "#e6b3a4", "-", "o"),
    AxisStyle("y", "#35a67c", "#b2dccc", (0.0, (6.0, 1.6)), "s"),
    AxisStyle("z", "#183680", "#a5b0cf", (0.0, (5.0, 1.4, 1.2, 1.4)), "^"),
)
"""Vermilion, green and dark blue: lightness 44, 62 and 25 of 100."""

SERIES = (
    AxisStyle("1", "#c03a17", "#e6b3a4", "-", "o"),
    AxisStyle("2", "#183680", "#a5b0cf", (0.0, (6.0, 1.6)), "s"),
    AxisStyle("3", "#35a67c", "#b2dccc", (0.0, (5.0, 1.4, 1.2, 1.4)), "^"),
    AxisStyle("4", "#b9770e", "#e5cda5", (0.0, (1.5, 1.2)), "D"),
    AxisStyle("5", "#7d3c98", "#cfb4da", (0.0, (9.0, 2.0)), "v"),
    AxisStyle("6", "#3b8fc4", "#b5d5ea", (0.0, (3.0, 1.2)), "P"),
    AxisStyle("7", "#555555", "#bfbfbf", (0.0, (7.0, 1.2, 1.2, 1.2, 1.2, 1.2)), "X"),
)
"""Colours of curves that belong to no axis, in their order within one chart."""

FORMATS = ("png", "svg", "pdf")

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",
    # Names inside an SVG are made from this: the same picture is the same file.
    "svg.hashsalt": "orientd",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


def is_available() -> bool:
    """Return whether pictures can be drawn here: Matplotlib is installed (extra ``plot``)."""
    return find_spec("matplotlib") is not None


def new_figure(width: float, height: float, title: str = "", *, is_laid_out: bool = True) -> Figure:
    """Return an empty figure of *width* by *height* inches, with a headline at its left.

    Where many charts have their places already, *is_laid_out* false saves looking for them.

    Raises:
        OrientdError: Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise OrientdError(
            "pictures need Matplotlib, which is not installed: pip install 'orientd-motion[plot]'"
        ) from error
    layout: Any = "constrained" if is_laid_out else "none"
    figure = Figure(figsize=(width, height), layout=layout, facecolor=PAPER)
    if title:
        figure.suptitle(title, x=0.012, ha="left", fontsize=13, color=INK, fontweight="bold")
    return figure


def check_format(path: Path) -> None:
    """Refuse a name whose ending is no format of a picture, before anything is drawn.

    Raises:
        OrientdError: it is none.
    """
    ending = path.suffix.removeprefix(".").lower()
    if ending not in FORMATS:
        allowed = ", ".join(f".{name}" for name in FORMATS)
        raise OrientdError(f"the name of a picture must end in {allowed}, got {path.name!r}")


def save(figure: Figure, path: Path | BinaryIO, *, dpi: int = 140) -> None:
    """Write *figure* to *path*, whose ending is one that :func:`check_format` allows.

    An open file gets a PNG.

    Raises:
        OrientdError: the file cannot be written.
    """
    from matplotlib import rc_context

    # A date would make two files of the same picture.
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    kind = path.suffix.removeprefix(".").lower() if isinstance(path, Path) else "png"
    whole = written(path) if isinstance(path, Path) else nullcontext(path)
    with whole as file, rc_context(_SETTINGS):
        figure.savefig(file, format=kind, dpi=dpi, metadata=undated.get(kind))


def tidy(axes: Axes, label: str = "") -> None:
    """Give a chart its common look: a quiet grid, no box, small ticks."""
    axes.set_ylabel(label, fontsize=9.0, color=INK)
    axes.grid(axis="y", color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8.0, colors=INK)
    axes.spines[["top", "right"]].set_visible(False)
