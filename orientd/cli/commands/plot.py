"""Pictures of the curve of a motion file, or of a recording."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import Annotated, Literal

import click

from orientd.cli.command import DeviceName, Partial, Topic, check_picture, need_extra
from orientd.cli.commands.compare import Ends, Times, need_two
from orientd.cli.installed import recordings_reader
from orientd.cli.output import Output, working
from orientd.cli.parameters import Argument, Option
from orientd.errors import OrientdError, RequestError

Show = Literal["motion", "triads", "rates", "body"]
"""The part of a motion file to draw."""

RECORDINGS = (".mcap", ".csv", ".tum", ".txt", ".db3")
"""Suffixes of files that are no motion files."""

_FIGURES = re.compile(r"(nielson|kks)-\d+")
"""Figures of the papers, which version 0.2 drew by their names."""


def plot(
    out: Output,
    file: Annotated[
        Path | None,
        Argument(metavar="FILE", help="A motion file, or a recording (.mcap, .csv, .tum, .txt)."),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            help="A .svg, .png or .pdf file; default: FILE as .svg, in the current folder.",
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
    """Draw the curve of a motion file, or a recording.

    For a motion file, this draws only the curve, without lead-in and limits.  `orientd plan --plot`
    draws the whole motion, and `orientd compare --plot` the curve of every method.
    """
    if file is None:
        raise click.UsageError(
            "expected a motion file or a recording; `orientd methods` lists the methods",
            click.get_current_context(),
        )
    path = output or Path(f"{file.stem}.svg")
    check_picture(path, named="--output")
    notes: tuple[str, ...] = ()
    with working(f"drawing {path}"):
        if not file.exists():
            raise OrientdError(f"{str(file)!r} is no file{_instead(str(file))}")
        if file.suffix in RECORDINGS:
            notes = _draw_recording(file, path, device, topic, partial=partial, last=last)
        else:
            _draw_file(file, path, show, times, ends)
    lines = [*(f"note: {note}" for note in notes), f"wrote {path}"]
    out.answer({"plot": path, "notes": notes}, *lines)


def _instead(name: str) -> str:
    """Return a hint at what serves in place of a *name* that version 0.2 drew."""
    from orientd.curves.contract import METHODS

    if name in METHODS:
        return (
            f"; set `method: {name}` in a motion file, or see its picture in the documentation, "
            "page Curves"
        )
    if _FIGURES.fullmatch(name):
        return "; see the figures of the papers in the documentation, page Figures of the papers"
    return ""


def _draw_recording(
    file: Path, path: Path, device: str, topic: str, *, partial: bool, last: float
) -> tuple[str, ...]:
    """Draw a recording of orientd or of another program, and return notes on it."""
    from orientd import plots

    need_extra("record")
    from orientd.recorder.planned import marks, planned_orientations
    from orientd.recorder.reader import NotOursError, load_recording

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
    from orientd.planner.methods import curve_of
    from orientd.planner.path import position_path
    from orientd.planner.resolve import in_device_coordinates
    from orientd.planner.task import distinct, task_of

    request = in_device_coordinates(motion_file.load(file), None)
    need_two(request)
    task = task_of(request, times, ends)
    curve = curve_of(request, task)
    traces = plots.traces_of(curve, task, limits=request.limits)
    title = f"{file.name}: {request.method}"
    if show == "motion":
        plots.draw_traces(path, traces, title=title)
    elif show != "body":
        plots.draw_part(path, traces, show, title=title)
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
        plots.draw_part(path, traces, show, title=title, positions=positions)
