"""A motion under way, shown: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

from orientd.cli import texts
from orientd.cli.output import is_terminal, say
from orientd.rpc import STALE, Progress
from orientd.stream import ServoState

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

PLAIN_INTERVAL = 0.5
"""Seconds between two plain lines."""


class ProgressView(Protocol):
    """Whatever shows progress."""

    def show(self, progress: Progress) -> None:
        """Show *progress*."""


class Silence:
    """Show nothing, where the answer is one JSON object."""

    def show(self, progress: Progress) -> None:
        """Show nothing."""


class Lines:
    """One line now and then."""

    def __init__(self) -> None:
        self._due = 0.0

    def show(self, progress: Progress) -> None:
        """Print a line, if the last one was long enough ago."""
        now = time.monotonic()
        if now >= self._due:
            self._due = now + PLAIN_INTERVAL
            say(f"{progress.path_time:.2f} of {progress.duration:.2f} s  {_figures(progress)}")


class LiveLine:
    """One line that changes, with a bar."""

    def __init__(self, bar: Bar, task: TaskID) -> None:
        self._bar = bar
        self._task = task

    def show(self, progress: Progress) -> None:
        """Change the line."""
        self._bar.update(
            self._task,
            total=progress.duration,
            completed=progress.path_time,
            times=f"{progress.path_time:.2f}/{progress.duration:.2f} s",
            figures=_figures(progress),
            heard=time.monotonic(),
        )


@contextlib.contextmanager
def view(title: str, *, is_silent: bool) -> Iterator[ProgressView]:
    """Show progress while the context lasts."""
    if is_silent:
        yield Silence()
    elif not is_terminal():
        yield Lines()
    else:
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
            yield LiveLine(bar, task)


def _figures(progress: Progress) -> str:
    # Before the first cycle of the motion, and after the last, no path is followed at any speed.
    is_as_planned = progress.speed == 1.0 or progress.state is ServoState.HOLDING
    speed = "" if is_as_planned else f"  speed {progress.speed:.2f}"
    paused = "  paused" if progress.is_paused else ""
    return (
        f"{texts.orientation(progress.q)}  {texts.rate(progress.omega_body):.3f} rad/s  "
        f"late {texts.milliseconds(progress.lateness)}  "
        f"tracking {texts.small_angle(progress.tracking_error)}{speed}{paused}"
    )
