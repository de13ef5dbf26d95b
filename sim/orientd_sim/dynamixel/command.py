"""Run the emulated bus from a command line until Ctrl-C or SIGTERM."""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from orientd.clock import MonotonicClock
from orientd_sim.dynamixel.bus import Bus
from orientd_sim.dynamixel.console import obey
from orientd_sim.dynamixel.line import SerialLine
from orientd_sim.dynamixel.pty import PtyServer
from orientd_sim.dynamixel.servo import EmulatedServo
from orientd_sim.dynamixel.table import BAUD_RATES, MODELS

DEFAULT_SERVOS = "1:xm430,2:xm430,3:xm430"
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
    link: Path,
    *,
    names: str = DEFAULT_SERVOS,
    baud: int = 1_000_000,
    line: SerialLine | None = None,
    seed: int = 0,
    console: int | None = None,
) -> None:
    """Serve an emulated bus at *link* until Ctrl-C or SIGTERM; print a line when it is ready.

    Args:
        link: where clients find the terminal; removed at the end.
        names: the servos, as :func:`servos` takes them.
        baud: the line speed they are set to.
        line: how long bytes take; by default the speed of *baud* with a 1 ms adapter.
        seed: of everything random.
        console: a descriptor from which commands are read, see :mod:`.console`.

    Raises:
        ValueError: *names* or *baud* is not allowed.
        FileExistsError: something that is not a symbolic link is in the link's place.
    """
    clock = MonotonicClock()
    bus = Bus(
        servos(names, baud=baud, now_ns=clock.now_ns()),
        line=line or SerialLine(is_paced=True, usb_latency_ns=1_000_000, has_collisions=False),
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
        server.close()


def _obey(command: str, server: PtyServer, now_ns: int) -> None:
    try:
        told = obey(command, server, now_ns)
    except (ValueError, OSError) as error:
        print(f"refused: {error}", flush=True)  # noqa: T201
    else:
        print(f"done: {command}{': ' if told else ''}{told}", flush=True)  # noqa: T201


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the emulated bus as the command line asks; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="orientd sim dynamixel", description="An emulated Dynamixel bus on a pseudo-terminal."
    )
    parser.add_argument("--link", type=Path, required=True, help="where clients find the port")
    parser.add_argument("--servos", default=DEFAULT_SERVOS, help=f"default {DEFAULT_SERVOS}")
    parser.add_argument("--baud", type=int, default=1_000_000, help="line speed, default 1000000")
    parser.add_argument("--ideal", action="store_true", help="let bytes take no time")
    parser.add_argument("--usb-ms", type=float, default=1.0, help="adapter delay, default 1 ms")
    parser.add_argument("--seed", type=int, default=0, help="of everything random")
    parser.add_argument("--console", action="store_true", help="read commands from standard input")
    options = parser.parse_args(arguments)
    line = SerialLine(
        is_paced=True, usb_latency_ns=round(options.usb_ms * 1e6), has_collisions=False
    )
    if options.ideal:
        line = SerialLine()
    try:
        run(
            options.link, names=options.servos, baud=options.baud, line=line, seed=options.seed,
            console=sys.stdin.fileno() if options.console else None,
        )  # fmt: skip
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return 1
    return 0
