"""`orientd stop` and `orientd halt`, whose word goes out before the command line is loaded.

The command line takes some 0.2 s to load and gRPC's library 0.1 s, and a device would move on
meanwhile.  So :mod:`orientd.first_stop` sends what these two commands plainly ask for.  This module
reports what the servos answered.  Whatever is not plain, and whatever goes wrong, is left to the
command line, which asks again.
"""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd.client.stop_call import ask_to_stop
from orientd.errors import OrientdError
from orientd.first_stop import Answers

if TYPE_CHECKING:
    from orientd.cli.output import Output
    from orientd.client.channel import Way
    from orientd.protocol import control_pb2 as pb

_TIMEOUT = 2.0
"""How long the daemon may take to be reached afterwards, s."""


def run(asked: dict[str, str], answers: Answers | None) -> bool:
    """Report a stop that has gone out; return whether the command line has nothing left to do.

    Args:
        asked: see :func:`orientd.first_stop.plain`.
        answers: of the servos; ``None`` if no servo was reached.
    """
    if answers is None:
        return False
    path, device, as_json = Path(asked["socket"]), asked["device"], "json" in asked
    try:
        told = ask_to_stop(path, asked["kind"], device, answers=answers)
    except OrientdError:
        return False
    if told is None:
        return False

    # The servos have taken the stop: from here on nothing is in a hurry.
    from orientd.cli import output
    from orientd.client.channel import Way

    try:
        tell_now(Way(path), device, output.Output(as_json=as_json))
    except OrientdError:
        _tell_little(told, as_json=as_json)
    except BrokenPipeError:
        output.close_output()
        raise SystemExit(1) from None
    return True


def tell_now(way: Way, device: str, out: Output) -> None:
    """Print the state of each device after a stop.

    Args:
        way: endpoint of the daemon.
        device: its name; empty for all of them.
        out: where to print.

    Raises:
        OrientdError: the daemon does not answer in time.
    """
    from orientd.client.connection import Connection

    with contextlib.closing(Connection(way, timeout=_TIMEOUT)) as connection:
        reports = connection.after_stop(device)
    tell(reports, out)


def tell(reports: list[pb.DeviceReport], out: Output) -> None:
    """Print the state of each device, a line for each."""
    from orientd.cli import texts

    lines = [f"{report.name}: {texts.state(report)}" for report in reports]
    out.answer({"devices": reports}, *lines)


def _tell_little(told: list[dict[str, Any]], *, as_json: bool) -> None:
    """Print what was stopped if the daemon does not answer."""
    devices = [{**one, "state": one["state"].lower()} for one in told]
    if as_json:
        lines = [json.dumps({"devices": devices, "daemon": "does not answer"})]
    else:
        lines = [f"{one['name']}: told to stop while {one['state']}" for one in devices]
        lines.append("the daemon does not answer")
    os.write(1, "".join(f"{line}\n" for line in lines).encode())
