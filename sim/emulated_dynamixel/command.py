"""Run the emulated bus for `orientd sim dynamixel`, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import random
import signal
from pathlib import Path

from emulated_dynamixel.bus import Bus
from emulated_dynamixel.clock import MonotonicClock
from emulated_dynamixel.console import obey
from emulated_dynamixel.line import SerialLine
from emulated_dynamixel.pty import PtyServer
from emulated_dynamixel.servo import EmulatedServo
from emulated_dynamixel.table import BAUD_RATES, MODELS

_GAP_NS = 20_000_000
_IDLE_S = 0.2


def servos(text: str, *, baud: int = 1_000_000, now_ns: int = 0) -> list[EmulatedServo]:
    """Return the servos that *text* names, as in ``1:xm430,2:xl330``.

    Raises:
        ValueError: the text, an id, a model or the line speed is not one there is.
    """
    if baud not in BAUD_RATES:
        raise ValueError(f"baud must be one of {', '.join(map(str, BAUD_RATES))}, got {baud}")
    found: dict[int, EmulatedServo] = {}
    for item in text.split(","):
        number, _, name = item.strip().partition(":")
        model = MODELS.get(name or "xm430")
        if not number.isdecimal() or int(number) > 252 or model is None:
            raise ValueError(
                f"servos must look like 1:xm430,2:xl330 with ids of 0 to 252, got {item!r}"
            )
        if int(number) in found:
            raise ValueError(f"servos must have different ids, got {number} twice")
        found[int(number)] = EmulatedServo(
            int(number), model, baud_index=BAUD_RATES.index(baud), now_ns=now_ns
        )
    return list(found.values())


def run(
    link: Path, *, names: str, baud: int, line: SerialLine, seed: int, console: int | None
) -> None:
    """Serve an emulated bus at *link* until Ctrl-C or SIGTERM; print a line when it is ready.

    Args:
        link: where clients find the terminal; removed at the end.
        names: the servos, as :func:`servos` takes them.
        baud: the line speed they are set to.
        line: how long bytes take.
        seed: of everything random.
        console: a descriptor from which commands are read, see :mod:`.console`; ``None`` for none.

    Raises:
        ValueError: *names* or *baud* is not allowed.
        FileExistsError: something that is not a symbolic link is in the link's place.
    """
    clock = MonotonicClock()
    bus = Bus(
        servos(names, baud=baud, now_ns=clock.now_ns()),
        line=line,
        rng=random.Random(seed),
        gap_ns=_GAP_NS,
    )
    server = PtyServer(bus, link, clock)
    stopping: list[int] = []
    previous = {
        number: signal.signal(number, lambda got, _: stopping.append(got))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    wake_read, wake_write = os.pipe()
    os.set_blocking(wake_write, False)
    previous_wake = signal.set_wakeup_fd(wake_write)
    try:
        server.plug()
        kinds = ", ".join(f"{servo.id} {servo.model.name}" for servo in bus.servos)
        print(f"ready: {link} at {baud} baud, servos {kinds}", flush=True)  # noqa: T201
        others = [wake_read] if console is None else [wake_read, console]
        pending = b""
        while not stopping:
            if console not in server.step(_IDLE_S, *others) or console is None:
                continue
            octets = os.read(console, 4096)
            if not octets:
                others, console = [wake_read], None
            *lines, pending = (pending + octets).split(b"\n")
            for command in lines:
                _obey(command.decode(errors="replace"), server, clock.now_ns())
    finally:
        signal.set_wakeup_fd(previous_wake)
        for number, handler in previous.items():
            signal.signal(number, handler)
        os.close(wake_read)
        os.close(wake_write)
        server.unplug()


def _obey(command: str, server: PtyServer, now_ns: int) -> None:
    try:
        told = obey(command, server, now_ns)
    except (ValueError, OSError) as error:
        print(f"refused: {error}", flush=True)  # noqa: T201
    else:
        print(f"done: {command}{': ' if told else ''}{told}", flush=True)  # noqa: T201
