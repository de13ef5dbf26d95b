"""Reproduce the figures of the papers from our own data, each by its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from generators.basis import INSTANTS, cumulative_functions, draw_functions
from generators.papers import scenes
from generators.papers.sweep import draw_sweep
from generators.papers.tips import draw_ideal, draw_tip_paths
from orientd.curves import METHODS
from orientd.curves.products import KksBspline
from orientd.plots.bodies import Face, draw_bodies, plate
from orientd.plots.paper import SERIES, check_format, new_figure, save
from orientd.plots.triads import TriadStyle, draw_triads
from orientd.plots.view import Viewpoint
from orientd.rotation import Floats, exp, multiply

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NIELSON = TriadStyle(view=Viewpoint(22.0, -50.0), number=9.0)
MOTION_VIEW = Viewpoint(24.0, -48.0)


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure that can be drawn by its name.

    Attributes:
        title: what it shows.
        draw: draws it on an empty chart.
        size: width and height, inches.
    """

    title: str
    draw: Callable[[Axes], None]
    size: tuple[float, float] = (7.0, 5.0)


def draw_figure(path: Path, name: str) -> None:
    """Draw a figure of :data:`FIGURES` to *path*.

    Raises:
        KeyError: there is no such figure.
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    chosen = FIGURES[name]
    figure = new_figure(*chosen.size)
    axes = figure.subplots()
    chosen.draw(axes)
    figure.suptitle(chosen.title, x=0.012, ha="left", fontsize=10.5)
    save(figure, path)


def _nielson(times: str) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        keys = scenes.samples_of_ideal()
        curve = METHODS["nielson_heiland"](keys=keys, times=times)
        q = curve.evaluate(np.linspace(*curve.domain, 3000))[0]
        ideal = scenes.ideal_orientation(np.linspace(0.0, 1.0, 2000))
        draw_triads(axes, q, keys, style=NIELSON)
        draw_ideal(axes, ideal, NIELSON)

    return draw


def _hermite_basis(axes: Axes) -> None:
    times = np.linspace(0.0, 1.0, INSTANTS)
    functions = cumulative_functions(np.repeat([0.0, 1.0], 4), 4, times)[1:]
    names = [rf"$\tilde\beta_{k}$" for k in (1, 2, 3)]
    draw_functions(axes, times, functions, names, marks=np.array([0.0, 1.0]))


def _bspline_basis(is_cumulative: bool) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        knots, times = np.arange(-3.0, 11.0), np.linspace(0.0, 7.0, INSTANTS)
        cumulative = cumulative_functions(knots, 4, times)
        # Those whose support is shown whole; an ordinary one is the step from one sum to the next.
        whole = slice(3, 7)
        functions = cumulative[whole]
        if not is_cumulative:
            functions = functions - cumulative[4:8]
        symbol = r"\tilde B" if is_cumulative else "B"
        names = [rf"${symbol}_{{{k},4}}$" for k in range(len(functions))]
        draw_functions(axes, times, functions, names, marks=np.arange(8.0))

    return draw


def _hermite_curves(axes: Axes) -> None:
    start, end = np.array([1.0, 0.0, 0.0, 0.0]), exp(np.array([0.2, 0.9, 1.3]))
    velocities = [[0.0, 0.0, 2.0], [0.0, 6.0, 2.0], [6.0, -4.0, 2.0], [0.0, -9.0, 6.0]]
    paths = []
    for look, omega1 in zip(SERIES, velocities, strict=False):
        curve = METHODS["kks_hermite"](q0=start, q1=end, omega0=[0.0, -2.0, 3.0], omega1=omega1)
        q = curve.evaluate(np.linspace(0.0, 1.0, 1500))[0]
        shown = ", ".join(f"{part:g}" for part in omega1)
        paths.append((q, replace(look, name=rf"$\omega_b$ = ({shown}) rad/s")))
    draw_tip_paths(
        axes, paths, np.array([1.0, 0.0, 0.0]), style=TriadStyle(view=Viewpoint(12.0, 60.0))
    )
    figure = axes.get_figure()
    if figure is not None:
        figure.legend(
            handles=axes.get_legend_handles_labels()[0],
            loc="outside lower center",
            ncols=2,
            frameon=False,
            fontsize=9,
            handlelength=4.0,
        )


def _bspline_curve(axes: Axes) -> None:
    controls = scenes.control_orientations()
    moved = controls.copy()
    moved[3] = multiply(moved[3], exp(np.array([0.0, 0.6, -0.5])))
    curves: list[Floats] = []
    for control in (controls, moved):
        curve = KksBspline(control=control, knots=scenes.CONTROL_KNOTS)
        curves.append(curve.evaluate(np.linspace(*curve.domain, 2000))[0])
    style = TriadStyle(view=Viewpoint(24.0, -20.0), number=9.0)
    draw_triads(axes, curves[0], controls, style=style, is_met=False)
    draw_ideal(axes, curves[1], style)


def _moving(
    make: Callable[[], scenes.PaperScene],
    body: Callable[[], list[Face]],
    count: int,
    view: Viewpoint,
) -> Callable[[Axes], None]:
    def draw(axes: Axes) -> None:
        scene = make()
        trail = scene.along(400).positions
        draw_bodies(axes, body(), scene.between(count), scene.keyframes, view, trail)

    return draw


def _swept(axes: Axes) -> None:
    draw_sweep(axes, scenes.cross_section(), scenes.blended_scene().along(220), MOTION_VIEW)


FIGURES: Mapping[str, PaperFigure] = {
    "nielson-10": PaperFigure(
        "Eight samples of an ideal orientation function (dotted), interpolated by spherical\n"
        "B-splines over uniform knots: loops and kinks between samples 5 and 6",
        _nielson("uniform"),
        (7.0, 7.2),
    ),
    "nielson-11": PaperFigure(
        "The same eight samples over knots spaced by chord length: no loops",
        _nielson("chord"),
        (7.0, 7.2),
    ),
    "kks-2": PaperFigure("The cumulative basis of the Hermite quaternion curve", _hermite_basis),
    "kks-3": PaperFigure(
        "Hermite quaternion curves between two orientations with the same velocity at the\n"
        "start and four velocities at the end: the tip of the x axis",
        _hermite_curves,
        (7.0, 8.0),
    ),
    "kks-4": PaperFigure("Cubic B-spline basis functions", _bspline_basis(is_cumulative=False)),
    "kks-5": PaperFigure("Their cumulative forms", _bspline_basis(is_cumulative=True)),
    "kks-6": PaperFigure(
        "A cubic B-spline quaternion curve over six control orientations (hollow);\n"
        "dotted: control orientation 4 moved, which changes the curve nearby only",
        _bspline_curve,
        (7.0, 7.2),
    ),
    "kks-7": PaperFigure(
        "A boomerang: one Hermite segment for the position, one for the orientation",
        _moving(scenes.boomerang_scene, scenes.boomerang, 36, Viewpoint(22.0, -120.0)),
        (9.0, 6.2),
    ),
    "kks-8": PaperFigure(
        "A rigid motion by a cubic B-spline in position and orientation; dark: control poses",
        _moving(scenes.blended_scene, plate, 30, MOTION_VIEW),
        (9.0, 5.2),
    ),
    "kks-9": PaperFigure("A cross-section swept along the same motion", _swept, (9.0, 5.2)),
    "kks-10": PaperFigure(
        "A rigid motion interpolated with continuous acceleration; dark: six keyframes",
        _moving(scenes.interpolated_scene, plate, 30, MOTION_VIEW),
        (9.0, 5.2),
    ),
}
"""By name: Nielson (1993), Figs. 10 and 11; Kim, Kim and Shin (1995), Figs. 2 to 10."""
