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

BAR = 20
"""Characters of the bar."""


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
            times = f"{progress.path_time:.2f} of {progress.duration:.2f} s"
            say(f"{times}  {_figures(progress)}{_pace(progress)}")

    return show


@contextlib.contextmanager
def _live_line(title: str) -> Iterator[Show]:
    """Yield what changes one line, which says how old it is once that is worth a word.

    If the terminal is too narrow the figures at its end are cut off.
    """
    # Rich takes its time to import, and most commands have no use for it.
    from rich.live import Live
    from rich.text import Text

    line, heard = Text(title), time.monotonic()

    def shown() -> Text:
        age = time.monotonic() - heard
        old = Text(f"{age:.0f} s old  " if age > STALE else "", "bold red")
        return Text.assemble(old, line, no_wrap=True, overflow="ellipsis")

    def show(progress: Progress) -> None:
        nonlocal line, heard
        heard = time.monotonic()
        times = f"{progress.path_time:.2f}/{progress.duration:.2f} s{_pace(progress)}"
        done = int(BAR * progress.path_time / max(progress.duration, 1e-9))
        bar = ("-" * done).ljust(BAR)
        line = Text.assemble(f"{title} {times} |{bar}| ", (_figures(progress), "dim"))

    with Live(get_renderable=shown):
        yield show


def _figures(progress: Progress) -> str:
    return (
        f"{texts.orientation(progress.q)}  {math.hypot(*progress.omega_body):.3f} rad/s  "
        f"late {texts.milliseconds(progress.lateness)}  "
        f"tracking {texts.small_angle(progress.tracking_error)}"
    )


def _pace(progress: Progress) -> str:
    """Return at what speed the path is followed, where that is not as planned."""
    # Before the first cycle of the motion, and after the last, no path is followed at any speed.
    is_as_planned = progress.speed == 1.0 or progress.state is ServoState.HOLDING
    speed = "" if is_as_planned else f"  speed {progress.speed:.2f}"
    return f"{speed}{'  paused' if progress.is_paused else ''}"
