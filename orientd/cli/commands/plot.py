"""Pictures: of the curve of a motion file, of a method, of a figure of the papers."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Literal

import click

from orientd.cli.command import DeviceName, Partial, Topic, check_picture, need_extra
from orientd.cli.commands.compare import Ends, Times, need_two
from orientd.cli.installed import recordings_reader
from orientd.cli.output import Output, table, working
from orientd.cli.parameters import Argument, Option
from orientd.errors import OrientdError, RequestError

Show = Literal["motion", "triads", "rates", "body"]
"""The part of a motion file to draw."""

RECORDINGS = (".mcap", ".csv", ".tum", ".txt", ".db3")
"""Suffixes of files that are no motion files."""


def _names(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the methods and figures that a shell may complete."""
    del context, parameter
    from orientd.curves import METHODS
    from orientd.plots import FIGURES

    return [name for name in (*METHODS, *FIGURES) if name.startswith(incomplete)]


def plot(
    out: Output,
    what: Annotated[
        str | None,
        Argument(
            metavar="FILE|NAME",
            help="A motion file, a recording (.mcap, .csv, .tum, .txt), or the name of a method "
            "or figure; without it, the names are listed.",
            shell_complete=_names,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="A .svg, .png or .pdf file; default: NAME.svg in the current folder.",
        ),
    ] = None,
    show: Annotated[
        Show,
        Option(
            "--show",
            help="For a motion file: axis traces and rates, one of them, or a moving body.",
        ),
    ] = "motion",
    times: Times = "file",
    ends: Ends = "rest",
    device: DeviceName = "",
    topic: Topic = "",
    partial: Partial = False,
    last: Annotated[
        float,
        Option(
            "--last", metavar="SECONDS", range=(0.0, None), help="Draw only the end of a recording."
        ),
    ] = 0.0,
) -> None:
    """Draw a motion file, a recording, a method or a paper's figure.

    For a motion file, this draws only the curve, without lead-in and limits.  `orientd plan --plot`
    draws the whole motion.  For a method, it draws an example.
    """
    from orientd import plots
    from orientd.curves import METHODS

    if what is None:
        _list(out)
        return
    path = output or Path(f"{Path(what).stem}.svg")
    check_picture(path, named="--output")
    notes: tuple[str, ...] = ()
    with working(f"drawing {path}"):
        if what in METHODS:
            plots.draw_family(path, what)
        elif what in plots.FIGURES:
            plots.draw_figure(path, what)
        elif Path(what).suffix in RECORDINGS and Path(what).exists():
            notes = _draw_recording(Path(what), path, device, topic, partial=partial, last=last)
        elif Path(what).exists():
            _draw_file(Path(what), path, show, times, ends)
        else:
            raise OrientdError(
                f"{what!r} is neither a file nor a name; `orientd plot` lists the names"
            )
    lines = [*(f"note: {note}" for note in notes), f"wrote {path}"]
    out.answer({"plot": path, "notes": notes}, *lines)


def _list(out: Output) -> None:
    from orientd.curves import METHODS
    from orientd.plots import FIGURES

    families = {name: family.summary for name, family in METHODS.items()}
    figures = {name: " ".join(figure.title.split()) for name, figure in FIGURES.items()}
    lines = table(["name", "what is drawn"], [*families.items(), *figures.items()])
    out.answer({"families": families, "figures": figures}, *lines)


def _draw_recording(
    file: Path, path: Path, device: str, topic: str, *, partial: bool, last: float
) -> tuple[str, ...]:
    """Draw a recording of orientd or of another program, and return notes on it."""
    from orientd import plots

    need_extra("record")
    from orientd.recorder import (
        NotOursError,
        load_recording,
        marks,
        planned_orientations,
    )

    if file.suffix == ".mcap" and not topic:
        with contextlib.suppress(NotOursError):
            recording = load_recording(file, partial=partial)
            name = recording.device(device)
            cycles, planned = recording.cycles[name], planned_orientations(recording, name)[1]
            first = max(0, len(cycles) - round(last * recording.rate_hz(name))) if last else 0
            shown = cycles[first:]
            begin_ns = int(shown["deadline_ns"][0]) if len(shown) else 0
            plots.draw_recording(
                path,
                shown,
                planned[first:],
                period=1.0 / recording.rate_hz(name),
                marks=[one for one in marks(recording, name) if one[0] >= begin_ns],
                title=f"{file.name}: {name}",
            )
            return (recording.damages.describe(),) if recording.damages else ()
    found = recordings_reader()(file, topic, partial=partial)
    title = ": ".join(filter(None, (file.name, found.topic)))
    plots.draw_orientations(path, found.times, found.q, title=title)
    return (f"drawn by {found.clock}", *found.notes)


def _draw_file(file: Path, path: Path, show: Show, times: Times, ends: Ends) -> None:
    import numpy as np

    from orientd import motion_file, plots
    from orientd.planner import curve_of, distinct, in_device_coordinates, position_path, task_of

    request = in_device_coordinates(motion_file.load(file), None)
    need_two(request)
    task = task_of(request, times, ends)
    curve = curve_of(request, task)
    traces = plots.traces_of(curve, task, limits=request.limits)
    title = f"{file.name}: {request.method}"
    if show == "triads":
        plots.draw_triads_alone(path, traces, title=title)
    elif show == "rates":
        plots.draw_rates_alone(path, traces, title=title)
    elif show == "motion":
        plots.draw_traces(path, traces, title=title)
    else:
        given = request.positions
        if given is not None and len(given) > len(task.times):
            given = given[distinct(request)]
        path_of_tool = position_path(task.times, given, np.zeros(3))
        positions = path_of_tool.sample(traces.times)[0]
        if not np.ptp(positions, axis=0).any():
            raise RequestError(
                "keyframes", "a body is drawn along positions, which these keyframes do not have"
            )
        plots.draw_bodies_alone(path, traces, positions, title=title)
