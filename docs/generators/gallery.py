"""A picture of every family: each on the same example, as soon as it is in ``METHODS``."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from orientd.curves import METHODS, CurveTask, make_curve, parameters
from orientd.curves.comparison import Figures, compare, measure, ranked
from orientd.errors import OrientdError
from orientd.plots.motion import draw_traces
from orientd.plots.paper import check_format
from orientd.plots.sampling import traces_of
from orientd.plots.sheet import draw_sheet
from orientd.rotation import from_euler

WORTH_PROCESSES = 4
"""Pictures from which on they are drawn on every core."""

_DEGREES = [
    [0.0, 0.0, 0.0],
    [35.0, -25.0, 20.0],
    [80.0, -30.0, 10.0],
    [120.0, 5.0, -30.0],
    [130.0, 45.0, -75.0],
    [165.0, 60.0, -140.0],
]


def example() -> CurveTask:
    """Return six orientations a second apart, as a camera would pass them."""
    return CurveTask(from_euler("ZYX", np.radians(_DEGREES)), np.arange(6.0))


def example_of_two() -> CurveTask:
    """Return two orientations, turning at both, for the families of one segment."""
    return CurveTask(
        from_euler("ZYX", np.radians([_DEGREES[0], _DEGREES[3]])),
        np.array([0.0, 2.0]),
        omega_start=np.array([0.5, 1.0, 2.5]),
        omega_end=np.array([-1.5, 1.0, 0.5]),
    )


def task_for(name: str) -> CurveTask:
    """Return the example that a family can do.

    Raises:
        KeyError: there is no such family.
    """
    six = example()
    try:
        parameters(METHODS[name], six)
    except ValueError:
        return example_of_two()
    return six


def draw_family(path: Path, name: str) -> None:
    """Draw a family on its example to *path*.

    Raises:
        KeyError: there is no such family.
        OrientdError: the file cannot be written, its ending names no format of a picture, or the
            family can do neither example.
    """
    check_format(path)
    family, task = METHODS[name], task_for(name)
    try:
        curve = make_curve(family, task)
    except ValueError as error:
        raise OrientdError(f"{name} has no curve for the example: {error}") from error
    figures = measure(curve, task)
    traces = traces_of(curve, task)
    draw_traces(
        path, traces, title=f"{name}: {family.summary}", note=f"{family.source}. {_note(figures)}"
    )


def _note(figures: Figures) -> str:
    met = (
        "meets its keyframes"
        if figures.interpolates
        else f"up to {np.degrees(figures.keyframe_error):.0f}° from its keyframes"
    )
    jumps = ", the velocity jumps" if figures.has_velocity_jumps else ""
    return (
        f"C{figures.continuity}, {met}{jumps}; integral of squared acceleration "
        f"{figures.effort:.3g} rad²/s³, peaks {figures.peak_velocity:.3g} rad/s and "
        f"{figures.peak_acceleration:.3g} rad/s²"
    )


def draw_gallery(directory: Path, ending: str = "svg") -> Iterator[Path]:
    """Draw every family, each to a file of its name, and all of them to one sheet.

    Args:
        directory: made if it is not there.
        ending: of the files, which names their format.

    Yields:
        The path of each picture once it is drawn; that of all of them, ``all``, is the last.

    Raises:
        OrientdError: a file cannot be written, or *ending* names no format of a picture.
    """
    check_format(Path(f"all.{ending}"))
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OrientdError(f"cannot make the folder {directory}: {error.strerror}") from error
    pictures = {directory / f"{name}.{ending}": name for name in METHODS}
    sheet = directory / f"all.{ending}"
    if len(pictures) < WORTH_PROCESSES:
        for path, name in pictures.items():
            draw_family(path, name)
            yield path
        _draw_sheet(sheet)
    else:
        # Not forked: the calling process may have threads.
        pool = ProcessPoolExecutor(
            len(os.sched_getaffinity(0)), get_context("spawn"), _leave_interrupts
        )
        try:
            last = pool.submit(_draw_sheet, sheet)
            drawn = {path: pool.submit(draw_family, path, name) for path, name in pictures.items()}
            for path, done in drawn.items():
                done.result()
                yield path
            last.result()
        finally:
            pool.shutdown(cancel_futures=True)
    yield sheet


def _draw_sheet(path: Path) -> None:
    task = example()
    draw_sheet(path, task, ranked(compare(task)), title="Every family on six orientations")


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that has started this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
