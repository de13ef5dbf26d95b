"""The progress of a motion: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from collections.abc import Callable, Iterator

from orientd.cli import texts
from orientd.cli.output import LiveLine, Output, is_terminal, updated
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import STALE, orientation
from orientd.protocol.values import to_quaternion, to_vector

PLAIN_INTERVAL = 0.5
"""Interval between two plain lines, s."""

REPAINT_INTERVAL = 0.1
"""Interval at which a live line is written again, s."""

BAR = 20
"""Characters of the bar."""


Show = Callable[[pb.MoveProgress], None]
"""Shows one report."""


@contextlib.contextmanager
def view(title: str, out: Output) -> Iterator[Show]:
    """Yield a function that shows progress while the context lasts."""
    if is_terminal() and not out.as_json:
        with _live_line(title) as show:
            yield show
    else:
        with updated(out, interval=PLAIN_INTERVAL) as say:
            yield lambda progress: say(
                f"{progress.path_time:.2f} of {progress.duration:.2f} s  "
                f"{_figures(progress)}{_pace(progress)}"
            )


@contextlib.contextmanager
def _live_line(title: str) -> Iterator[Show]:
    """Yield a function that updates one line, which shows its age once that matters.

    If the terminal is too narrow, the figures at the end are cut off.  A thread writes the line, so
    that its age grows while no report comes.
    """
    line, text, heard = LiveLine(sys.stdout), title, time.monotonic()
    has_ended = threading.Event()

    def paint() -> None:
        age = time.monotonic() - heard
        line.show(f"{age:.0f} s old  {text}" if age > STALE else text)

    def repaint() -> None:
        while not has_ended.wait(REPAINT_INTERVAL):
            paint()

    def show(progress: pb.MoveProgress) -> None:
        nonlocal text, heard
        heard = time.monotonic()
        times = f"{progress.path_time:.2f}/{progress.duration:.2f} s{_pace(progress)}"
        done = int(BAR * progress.path_time / max(progress.duration, 1e-9))
        bar = ("-" * done).ljust(BAR)
        text = f"{title} {times} |{bar}| {_figures(progress)}"

    painter = threading.Thread(target=repaint, name="progress", daemon=True)
    painter.start()
    try:
        yield show
    finally:
        has_ended.set()
        painter.join()
        paint()
        line.end()


def _figures(progress: pb.MoveProgress) -> str:
    error = progress.tracking_error if progress.HasField("tracking_error") else None
    speed = math.hypot(*to_vector(progress.omega_body))
    return (
        f"{orientation(to_quaternion(progress.q))}  {speed:.3f} rad/s  "
        f"late {texts.milliseconds(progress.lateness)}  "
        f"tracking {texts.small_angle(error)}"
    )


def _pace(progress: pb.MoveProgress) -> str:
    """Return the speed on the path, if it is not as planned."""
    # Before the first cycle of the motion, and after the last, there is no speed on a path.
    is_as_planned = progress.speed == 1.0 or progress.state == pb.STATE_HOLDING
    speed = "" if is_as_planned else f"  speed {progress.speed:.2f}"
    return f"{speed}{'  paused' if progress.is_paused else ''}"
