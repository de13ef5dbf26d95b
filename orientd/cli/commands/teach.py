"""`orientd teach`: move a device by hand and record its poses as the keyframes of a motion."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from orientd.cli.command import DeviceName, Endpoint, check_ending
from orientd.cli.output import LiveLine, Output
from orientd.cli.parameters import Argument, Option
from orientd.errors import DeviceError, OrientdError, StateError

if TYPE_CHECKING:
    from orientd.client.teaching import Teaching
    from orientd.model.request import Keyframe

ENDINGS = (".yaml", ".yml", ".json")

_REFRESH = 0.1
"""Interval between two displays of the pose, s."""

_KEYS = {" ": "take", "\n": "take", "\r": "take", "\x7f": "remove", "\b": "remove", "x": "remove",
         "n": "name", "q": "end", "\x04": "end"}  # fmt: skip

_HELP = "space adds the pose, backspace removes the last, n names it, q ends"


def teach(
    at: Endpoint,
    out: Output,
    file: Annotated[
        Path, Argument(metavar="OUT.yaml", help="The motion file to write, YAML or JSON.")
    ],
    device: DeviceName = "",
    name: Annotated[str, Option("--name", help="Name of the motion.")] = "",
    watch: Annotated[
        bool,
        Option("--watch", help="Do not release the device; another program moves it."),
    ] = False,
) -> None:
    """Move a device by hand, and save poses as keyframes.

    Meanwhile an arm is in freedrive.  A gimbal has no torque: hold it.  At the end the device holds
    its pose, and follows setpoints again if it did before.  Keys: space adds the pose with the time
    since the first one, backspace removes the last keyframe, n names it, q ends.  SIGUSR1 also adds
    the pose.  Without a terminal each line of standard input is `take`, `take NAME`, `remove`,
    `name NAME` or `end`.
    """
    check_ending(file, ENDINGS, named="OUT.yaml")
    if file.exists():
        raise OrientdError(f"cannot write {file}: it is there already")

    with at.connect("teach") as robot:
        if not watch:
            robot.acquire_lease(device)
        # From here on a signal is a command, and in any case the device holds again at the end.
        with _Orders() as orders, robot.teach(device=device, by_hand=not watch) as teaching:
            out.say(f"{teaching.device}: {'watched' if watch else 'can be moved by hand'}")
            out.say(*([_HELP] if orders.is_terminal else ()))
            _follow(teaching, orders, file, name, out)
            # Reported before the device holds again: the file exists in any case.
            _conclude(teaching, file, name, out)


def _conclude(teaching: Teaching, file: Path, name: str, out: Output) -> None:
    """Write the recorded keyframes, and report it.

    Raises:
        OrientdError: there are none.
    """
    if not teaching.keyframes:
        file.unlink(missing_ok=True)
        raise OrientdError("no keyframe was taken; nothing is written")
    request = teaching.save(file, name)
    count, duration = len(request.keyframes), request.keyframes[-1].time or 0.0
    out.answer(
        {"file": file, "keyframes": count, "duration": duration},
        f"wrote {file}: {count} keyframes in {duration:.2f} s",
    )


def _follow(teaching: Teaching, orders: _Orders, file: Path, name: str, out: Output) -> None:
    """Execute commands until the end; after each, the file has all keyframes."""
    line = LiveLine(sys.stdout)
    is_live = orders.is_terminal and not out.as_json
    while True:
        order = orders.next(_REFRESH)
        if is_live:
            line.show(_live(teaching) if order is None else "")
        if order is None:
            continue
        verb, _, text = order.partition(" ")
        if verb == "end":
            return
        if verb == "name" and not text:
            text = orders.ask("name: ")
        try:
            said = _obey(teaching, verb, text.strip())
            if teaching.keyframes:
                teaching.save(file, name)
        except (DeviceError, StateError, ValueError) as error:
            said = f"not done: {error}"
        out.say(said)


def _obey(teaching: Teaching, verb: str, text: str) -> str:
    """Execute one command and return its message.

    Raises:
        ValueError: it is not a command.
    """
    if verb == "take":
        return _told(len(teaching.keyframes), teaching.take(text))
    if verb == "remove":
        gone = teaching.remove()
        return "there is none" if gone is None else f"removed {len(teaching.keyframes) + 1}"
    if verb == "name":
        teaching.name(text)
        count = len(teaching.keyframes)
        return f"{count} is called {text!r}" if count else "there is none"
    raise ValueError(f"expected take, remove, name or end, got {verb!r}")


def _told(number: int, keyframe: Keyframe) -> str:
    from orientd.protocol.reports import orientation

    called = f" {keyframe.name!r}" if keyframe.name else ""
    place = ", ".join(f"{part:.4f}" for part in keyframe.position or ())
    return (
        f"{number + 1}{called} at {keyframe.time or 0.0:.2f} s: {orientation(keyframe.q)}, "
        f"position {place} m"
    )


def _live(teaching: Teaching) -> str:
    from orientd.protocol.reports import orientation

    try:
        here = teaching.pose()
    except DeviceError as error:
        return str(error)
    place = ", ".join(f"{part:.4f}" for part in here.position)
    return f"{len(teaching.keyframes)} taken; {orientation(here.q)}, position {place} m"


class _Orders:
    """The next commands: keys of a terminal, lines of a pipe, signals."""

    def __init__(self) -> None:
        self.is_terminal = sys.stdin.isatty() and sys.stdout.isatty()
        self._pending = b""
        self._orders: list[str] = []
        self._cleanup = contextlib.ExitStack()

    def __enter__(self) -> _Orders:
        if self.is_terminal:
            # The terminal passes on every key at once, and shows none.
            self._cleanup.enter_context(_terminal_as_before())
            tty.setcbreak(sys.stdin)
        handlers = {signal.SIGUSR1: "take", signal.SIGINT: "end", signal.SIGTERM: "end"}
        # A signal also wakes a process that waits in select.
        read, write = os.pipe()
        os.set_blocking(write, False)
        self._wake = read
        self._cleanup.callback(os.close, read)
        self._cleanup.callback(os.close, write)
        self._cleanup.callback(signal.set_wakeup_fd, signal.set_wakeup_fd(write))
        for number, order in handlers.items():
            before = signal.signal(number, lambda *_, order=order: self._orders.append(order))
            self._cleanup.callback(signal.signal, number, before)
        return self

    def __exit__(self, *_: object) -> None:
        self._cleanup.close()

    def next(self, seconds: float) -> str | None:
        """Return the next command; ``None`` after a time without one."""
        if not self._orders:
            ready, _, _ = select.select([sys.stdin.fileno(), self._wake], [], [], seconds)
            if self._wake in ready:
                os.read(self._wake, 64)
            elif ready:
                self._read()
        return self._orders.pop(0) if self._orders else None

    def ask(self, prompt: str) -> str:
        """Return a typed line; empty without a terminal."""
        if not self.is_terminal:
            return ""
        with _terminal_as_before() as settings:
            # Line mode again, with echo.
            settings[3] |= termios.ICANON | termios.ECHO
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
            sys.stdout.write(prompt)
            sys.stdout.flush()
            return sys.stdin.readline().strip()

    def _read(self) -> None:
        octets = os.read(sys.stdin.fileno(), 4096)
        if self.is_terminal:
            keys = octets.decode(errors="replace")
            self._orders += [_KEYS[key] for key in keys if key in _KEYS]
            return
        *lines, self._pending = (self._pending + octets).split(b"\n")
        self._orders += [line.decode(errors="replace").strip() or "take" for line in lines]
        if not octets:
            self._orders.append("end")


@contextlib.contextmanager
def _terminal_as_before() -> Iterator[list[Any]]:
    """Yield the settings of the terminal, and restore them at the end of the context."""
    before = termios.tcgetattr(sys.stdin)
    try:
        yield termios.tcgetattr(sys.stdin)
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
