"""Run an emulated bus on a pseudo-terminal, until Ctrl-C or SIGTERM."""

from __future__ import annotations

import os
import random
import signal
import time
from pathlib import Path

from emulated_dynamixel.bus import Bus
from emulated_dynamixel.console import carry_out
from emulated_dynamixel.line import SerialLine
from emulated_dynamixel.pty import PtyServer
from emulated_dynamixel.servo import EmulatedServo
from emulated_dynamixel.table import BAUD_RATES, MODELS

_GAP_NS = 20_000_000


def servos(text: str, *, baud: int = 1_000_000, now_ns: int = 0) -> list[EmulatedServo]:
    """Return the servos in *text*, as in ``1:xm430,2:xl330``.

    Raises:
        ValueError: the text, an id, a model or the line speed is not valid.
    """
    if baud not in BAUD_RATES:
        raise ValueError(f"baud must be one of {', '.join(map(str, BAUD_RATES))}, got {baud}")
    models = {**MODELS, **{model.name.lower(): model for model in MODELS.values()}}
    found: dict[int, EmulatedServo] = {}
    for item in text.split(","):
        number, _, name = item.strip().partition(":")
        model = models.get(name.lower() or "xm430")
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
        link: link to the terminal for clients; removed at the end.
        names: the servos, as for :func:`servos`.
        baud: their line speed.
        line: timing of bytes.
        seed: random seed.
        console: a descriptor from which to read commands, see :mod:`.console`; ``None`` for none.

    Raises:
        ValueError: *names* or *baud* is not valid.
        FileExistsError: *link* exists and is not a symbolic link.
    """
    found = servos(names, baud=baud, now_ns=time.monotonic_ns())
    server = PtyServer(Bus(found, line=line, rng=random.Random(seed), gap_ns=_GAP_NS), link)
    stopping: list[int] = []
    previous = {
        number: signal.signal(number, lambda got, _: stopping.append(got))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        server.plug()
        kinds = ", ".join(f"{servo.id} {servo.model.name}" for servo in found)
        print(f"ready: {link} at {baud} baud, servos {kinds}", flush=True)  # noqa: T201
        pending = b""
        while not stopping:
            is_asked = server.step(*([] if console is None else [console]))
            if console is None or not is_asked:
                continue
            octets = os.read(console, 4096)
            *lines, pending = (pending + octets).split(b"\n")
            for command in lines:
                said = carry_out(command.decode(errors="replace"), server, time.monotonic_ns())
                print(said, flush=True)  # noqa: T201
            console = console if octets else None
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
        server.unplug()
