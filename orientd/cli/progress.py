"""A motion under way, shown: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator

from orientd.cli import texts
from orientd.cli.output import is_terminal, say
from orientd.rpc import STALE, Progress
from orientd.stream import ServoState

PLAIN_INTERVAL = 0.5
"""Seconds between two plain lines."""


Show = Callable[[Progress], None]
"""Shows one report."""


@contextlib.contextmanager
def view(title: str, *, is_silent: bool) -> Iterator[Show]:
    """Yield what shows progress while the context lasts."""
    if is_silent:
        yield lambda _: None
    elif not is_terminal():
        yield _lines()
    else:
        with _live_line(title) as show:
            yield show


def _lines() -> Show:
    """Return what prints a line, if the last one was long enough ago."""
    due = 0.0

    def show(progress: Progress) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + PLAIN_INTERVAL
            say(f"{progress.path_time:.2f} of {progress.duration:.2f} s  {_figures(progress)}")

    return show


@contextlib.contextmanager
def _live_line(title: str) -> Iterator[Show]:
    """Yield what changes one line, with a bar."""
    # Rich takes its time to import, and most commands have no use for it.
    from rich.progress import BarColumn, ProgressColumn, Task, TextColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    class Age(ProgressColumn):
        """How old the line is, once that is worth a word."""

        def render(self, task: Task) -> Text:
            age = time.monotonic() - task.fields["heard"]
            return Text(f"{age:.0f} s old" if age > STALE else "", "bold red", no_wrap=True)

    columns = (
        Age(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TextColumn("{task.fields[times]}"),
        TextColumn("{task.fields[figures]}", style="dim"),
    )
    with Bar(*columns) as bar:
        now = time.monotonic()
        task = bar.add_task(title, total=1.0, times="", figures="", heard=now)
        yield lambda progress: bar.update(
            task,
            total=progress.duration,
            completed=progress.path_time,
            times=f"{progress.path_time:.2f}/{progress.duration:.2f} s",
            figures=_figures(progress),
            heard=time.monotonic(),
        )


def _figures(progress: Progress) -> str:
    # Before the first cycle of the motion, and after the last, no path is followed at any speed.
    is_as_planned = progress.speed == 1.0 or progress.state is ServoState.HOLDING
    speed = "" if is_as_planned else f"  speed {progress.speed:.2f}"
    paused = "  paused" if progress.is_paused else ""
    return (
        f"{texts.orientation(progress.q)}  {math.hypot(*progress.omega_body):.3f} rad/s  "
        f"late {texts.milliseconds(progress.lateness)}  "
        f"tracking {texts.small_angle(progress.tracking_error)}{speed}{paused}"
    )
