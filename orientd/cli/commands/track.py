"""`orientd track`: follow targets that arrive on standard input."""

from __future__ import annotations

import json
import queue
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from inspect import signature
from typing import TYPE_CHECKING, Annotated

import click

from orientd.cli.command import Commander
from orientd.cli.output import Output
from orientd.cli.parameters import Option
from orientd.one_line import counted, one_line
from orientd.spelling import unknown_key

if TYPE_CHECKING:
    from orientd.client.tracking import Tracking

_NAMED = 10
"""Most bad lines that are reported."""

_EXAMPLE = 'write lines such as {"rotation_vector": [0, 0, 0.3]}'

_LOOK = 0.1
"""Interval between two checks whether tracking has ended, while no line arrives, s."""


def track(
    to: Commander,
    out: Output,
    time_to_live: Annotated[
        float,
        Option(metavar="SECONDS", help="Time to live of targets that do not give their own."),
    ] = 0.5,
) -> None:
    """Follow targets that arrive on standard input.

    Each line is one JSON object.  The device comes to rest at the end of input. A target has an
    orientation as in a motion file, and may have `angular_velocity` (rad/s) with `velocity_frame`,
    `position` (m), `time_ns` (monotonic clock) and `time_to_live` (s):

    {"rotation_vector": [0, 0, 0.3], "angular_velocity": [0, 0, 1], "time_to_live": 0.2}

    A line with `base` is a sample of the orientation of a moving base, as `orientd sim base` prints
    it.  A line with `point` (m) is a point to look at, with the arguments of `look_at()` in Python:

    {"point": [5, 1, 0], "velocity": [0, 2, 0], "roll": 0}

    The command skips a bad line and reports it on standard error.  The exit status is 1 if every
    line was bad.
    """
    from orientd.protocol.reports import orientation
    from orientd.protocol.values import to_quaternion

    lines = _Lines(time_to_live)
    with to.connect("track") as robot:
        with robot.track(device=to.device) as tracking:
            lines.feed(_arriving(tracking), tracking)
        report = tracking.report
    report.refused += lines.bad
    report.refusal = report.refusal or lines.last
    out.answer(
        report,
        f"{counted(report.targets, 'target')} followed, {report.left_out} late or replaced, "
        f"{report.refused} refused",
        f"at rest at {orientation(to_quaternion(report.q))}",
        *([f"held at the keep-out cone {report.held_at!r}"] if report.held_at else []),
        *([f"last refusal: {report.refusal}"] if report.refusal else []),
    )
    if report.refused and not report.targets:
        raise click.exceptions.Exit(1)


def _arriving(tracking: Tracking) -> Iterator[bytes]:
    """Yield the lines of standard input as they arrive, until its end.

    Raises:
        OrientdError: tracking has ended.
    """
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(lines,), name="orientd input", daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=_LOOK)
        except queue.Empty:
            tracking.raise_if_ended()
            continue
        if not line:
            return
        yield line


def _read(lines: queue.SimpleQueue[bytes]) -> None:
    # Not sys.stdin: the interpreter needs its lock to end, and this thread may wait for a line.
    with open(sys.stdin.fileno(), "rb", closefd=False) as arriving:
        for line in arriving:
            lines.put(line)
    lines.put(b"")


class _Lines:
    """Targets from lines; a bad line is reported once, counted and skipped.

    Attributes:
        bad: number of lines that were no targets.
        last: the problem of the last of them.
    """

    def __init__(self, time_to_live: float) -> None:
        """Set the default time to live of targets, in seconds."""
        self.bad = 0
        self.last = ""
        self._time_to_live = time_to_live

    def feed(self, lines: Iterable[bytes], tracking: Tracking) -> None:
        """Give a session what every valid line asks for."""
        from orientd.errors import StaleBaseError

        problems = (ValueError, TypeError, OverflowError, RecursionError, StaleBaseError)
        for number, line in enumerate(lines, 1):
            if not line.strip():
                continue
            try:
                self._take(line, tracking)
            except problems as error:
                self.bad += 1
                self.last = one_line(f"line {number}: {error}")
                if self.bad <= _NAMED:
                    more = "; further ones are only counted" if self.bad == _NAMED else ""
                    print(f"orientd: {self.last}{more}", file=sys.stderr, flush=True)  # noqa: T201

    def _take(self, line: bytes, tracking: Tracking) -> None:
        """Give a session what a line asks for.

        Raises:
            ValueError: it is no target.
            StaleBaseError: it is one in the world, and the base is stale.
        """
        from orientd.client.target_messages import TARGET_KEYS, target_message
        from orientd.protocol.targets import target_from_message

        try:
            mapping = json.loads(line, parse_constant=_refuse_constant)
        except json.JSONDecodeError as error:
            problem = f"expected a JSON object: {error.msg}, column {error.colno}; {_EXAMPLE}"
            raise ValueError(problem) from None
        if not isinstance(mapping, dict):
            came = one_line(repr(mapping), 60)
            raise ValueError(f"expected a JSON object, got {came}; {_EXAMPLE}")
        for key, call in (("point", tracking.look_at), ("base", tracking.base)):
            if key in mapping:
                place = mapping.pop(key)
                _check_keys(mapping, call)
                call(place, **mapping)
                return
        options = {key: mapping.pop(key) for key in TARGET_KEYS if key in mapping}
        message = target_message(mapping, **{"time_to_live": self._time_to_live, **options})
        # The daemon's checks, except how far a target is ahead of the daemon's clock.
        target_from_message(message, message.time_ns)
        tracking.hand_over(message)


def _check_keys(mapping: Mapping[str, object], call: Callable[..., None]) -> None:
    """Check that a line has only keys that are arguments of *call*.

    Raises:
        ValueError: it has another one.
    """
    known = [
        one.name for one in signature(call).parameters.values() if one.kind is one.KEYWORD_ONLY
    ]
    for key in mapping:
        if key not in known:
            raise ValueError(f"{key}: {unknown_key(key, known)}")


def _refuse_constant(name: str) -> float:
    raise ValueError(f"expected finite numbers, got {name}; leave out this target")
