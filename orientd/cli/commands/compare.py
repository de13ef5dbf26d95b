"""Compare all interpolation methods on the keyframes of a motion file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import click

from orientd.cli.command import check_picture
from orientd.cli.commands.motion_commands import MotionFile
from orientd.cli.output import Output, table, working
from orientd.cli.parameters import Option
from orientd.errors import RequestError

if TYPE_CHECKING:
    from orientd.curves.comparison import Candidate, Figures
    from orientd.model.request import MotionRequest
    from orientd.rotation import Floats


Times = Annotated[
    Literal["file", "uniform", "chord"],
    Option(
        "--times",
        help="Keyframe times: from the file (else chord), every second, or by chord length.",
    ),
]
"""Source of the keyframes' times."""

Ends = Annotated[
    Literal["rest", "natural"],
    Option(
        "--ends",
        help="An end without a velocity in the file: at rest (as planned), or natural (without "
        "acceleration).",
    ),
]
"""Condition of an end without a velocity in the file."""

Column = Literal[
    "name", "effort", "torque", "acceleration", "velocity", "length", "continuity", "keyframes",
    "ends", "build", "sample",
]  # fmt: skip
"""Column by which the methods are sorted."""


def compare(
    out: Output,
    file: MotionFile,
    plot: Annotated[
        Path | None,
        Option("--plot", help="Draw all methods side by side to an image file."),
    ] = None,
    inertia: Annotated[
        str | None,
        Option(
            "--inertia",
            metavar="IX,IY,IZ",
            help="Principal moments of inertia, kg m^2: adds the integral of the squared torque.",
        ),
    ] = None,
    times: Times = "file",
    ends: Ends = "rest",
    sort: Annotated[Column, Option("--sort", help="Sort by this column, best first.")] = "effort",
) -> None:
    """Compare all interpolation methods on the keyframes of FILE.

    The curve of the file's own method is that of `orientd plan`.  Needs no daemon.
    """
    moments = _moments(inertia)
    if sort == "torque" and moments is None:
        raise click.BadParameter("needs --inertia", param_hint="--sort torque")

    from orientd import motion_file, plots
    from orientd.curves.comparison import compare as compared
    from orientd.curves.comparison import ranked
    from orientd.planner.resolve import in_device_coordinates
    from orientd.planner.task import task_of

    if plot is not None:
        check_picture(plot)
    request = in_device_coordinates(motion_file.load(file), None)
    need_two(request)
    task = task_of(request, times, ends)
    options = {request.method: dict(request.options)}
    with working("comparing"):
        candidates = ranked(compared(task, inertia=moments, options=options), sort)
    if plot is not None:
        title = f"{file.name}: every family"
        with working(f"drawing {plot}"):
            plots.draw_sheet(plot, task, candidates, limits=request.limits, title=title)
    out.answer(
        {"times": task.times, "families": list(map(_row, candidates)), "plot": plot},
        *_lines(candidates, has_torque=moments is not None),
        *(["", f"wrote {plot}"] if plot is not None else []),
    )


def need_two(request: MotionRequest) -> None:
    """Refuse a motion without a curve.

    Raises:
        RequestError: it has a single keyframe.
    """
    if len(request.keyframes) == 1:
        raise RequestError("keyframes", "expected at least 2 for a curve, got 1")


def _moments(text: str | None) -> Floats | None:
    """Return the moments of inertia in ``"IX,IY,IZ"``."""
    if text is None:
        return None
    import numpy as np

    try:
        moments = np.array([float(part) for part in text.split(",")])
    except ValueError:
        moments = np.zeros(0)
    if moments.shape != (3,) or not np.all(np.isfinite(moments)) or not np.all(moments > 0.0):
        raise click.BadParameter(
            f"expected three numbers above 0, like 0.2,0.2,0.1, got {text!r}",
            param_hint="--inertia",
        )
    return moments


def _row(candidate: Candidate) -> dict[str, Any]:
    """Return the result of one method as JSON."""
    figures = candidate.figures
    if figures is None:
        return {"name": candidate.name, "applies": False, "why_not": candidate.why_not}
    return {
        "name": candidate.name,
        "applies": True,
        "interpolates": figures.interpolates,
        **asdict(figures),
        "build_time": candidate.build_time,
        "sample_time": candidate.sample_time,
    }


def _lines(candidates: Sequence[Candidate], *, has_torque: bool) -> list[str]:
    """Return the table as text, followed by the methods that do not apply."""
    measured = [(one, one.figures) for one in candidates if one.figures is not None]
    absent = [[one.name, one.why_not] for one in candidates if one.figures is None]
    columns: list[tuple[str, Callable[[Candidate, Figures], str]]] = [
        ("method", lambda c, _: c.name),
        ("keyframes", lambda _, f: "met" if f.interpolates else f"off {f.keyframe_error:.3g} rad"),
        ("smooth", lambda _, f: f"C{f.continuity}"),
    ]
    if any(figures.end_velocity_error is not None for _, figures in measured):
        columns.append(("ends off, rad/s", lambda _, f: _error(f.end_velocity_error)))
    columns += [
        ("rad/s", lambda _, f: f"{f.peak_velocity:.4g}"),
        ("rad/s^2", lambda _, f: f"{f.peak_acceleration:.4g}{_mark(f)}"),
        ("effort", lambda _, f: f"{f.effort:.4g}{_mark(f)}"),
    ]
    if has_torque:
        columns.append(("torque", lambda _, f: f"{f.torque_effort or 0.0:.4g}{_mark(f)}"))
    columns += [
        ("length, rad", lambda _, f: f"{f.path_length:.4g}"),
        ("build", lambda c, _: f"{1e3 * c.build_time:.2f} ms"),
        ("sample", lambda c, _: f"{1e6 * c.sample_time:.2f} us"),
    ]
    rows = [[of(candidate, figures) for _, of in columns] for candidate, figures in measured]
    lines = table([name for name, _ in columns], rows) if rows else []
    lines += ["", "rad/s, rad/s^2: peaks; effort: integral of squared acceleration, rad^2/s^3"]
    if has_torque:
        lines[-1] += "; torque: of squared torque, N^2 m^2 s"
    if any(figures.has_velocity_jumps for _, figures in measured):
        lines.append("* and at a keyframe infinite: the velocity jumps there")
    if absent:
        lines += ["", *table(["does not apply", "why not"], absent)]
    return lines


def _error(error: float | None) -> str:
    return "" if error is None else f"{error:.1e}" if error < 1e-3 else f"{error:.3f}"


def _mark(figures: Figures) -> str:
    return "*" if figures.has_velocity_jumps else ""
