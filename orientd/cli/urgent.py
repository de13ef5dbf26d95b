"""`orientd stop` and `orientd halt`, on their way before the command line is loaded.

Typer, with the library it checks options by, takes some 0.2 s to load and gRPC's library 0.1 s
more, in which what moves would move on.  What these two commands are plainly asked for is read
without both, and sent before even this is loaded (:mod:`orientd.first_stop`); whatever is not
plain, and whatever goes wrong, is left to the command line, which asks the daemon again.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd.errors import OrientdError
from orientd.rpc import ask_to_stop, begin_call, read_answer, text_fields

if TYPE_CHECKING:
    from orientd.rpc import DeviceReport

TIMEOUT = 5.0
"""How long the daemon may take over a stop, s."""

REPORT_TIMEOUT = 1.0
"""How long it may take to say how devices are that are stopped already, s."""


def run(asked: dict[str, str], begun: int = -1) -> bool:
    """Carry out a stop; return whether that is done.

    Args:
        asked: see :func:`orientd.first_stop.plain`.
        begun: the connection by which the stop has gone out already; -1 where it has not.
    """
    path, kind, device = Path(asked["socket"]), asked["kind"], asked["device"]
    try:
        message = text_fields(device)
        told = ask_to_stop(path, kind, device, begun=begun)
    except (ValueError, OrientdError):
        return False
    if told is None:
        caller = f"orientd {kind}, process {os.getpid()}"
        content = _asked(
            path, f"orientd.v1.Control/{kind.capitalize()}", text_fields(device, caller)
        )
    else:
        content = _asked(path, "orientd.v1.Control/GetState", message, timeout=REPORT_TIMEOUT)
        if content is None:
            _tell_little(told, as_json="json" in asked)
            return True
    if content is None:
        return False

    # What moved is stopped: from here on nothing is in a hurry.
    from orientd.cli import output
    from orientd.rpc import device_from_message
    from orientd.rpc.control_pb2 import GetStateResponse, StopResponse

    # A HaltResponse is the same on the wire as a StopResponse.
    answer = (StopResponse if told is None else GetStateResponse).FromString(content)
    try:
        tell([device_from_message(one) for one in answer.devices], as_json="json" in asked)
    except BrokenPipeError:
        output.close_output()
        raise SystemExit(1) from None
    return True


def tell(reports: list[DeviceReport], *, as_json: bool) -> None:
    """Say what each device was doing when it was told to come to rest."""
    from orientd.cli import texts
    from orientd.cli.output import answer

    lines = [f"{report.name}: {texts.state(report)}" for report in reports]
    answer({"devices": reports}, *lines, as_json=as_json)


def _asked(path: Path, method: str, message: bytes, *, timeout: float = TIMEOUT) -> bytes | None:
    connection = begin_call(str(path), method, message, timeout=timeout)
    return None if connection is None else read_answer(connection)


def _tell_little(told: list[dict[str, Any]], *, as_json: bool) -> None:
    """Say what was stopped, where the daemon says nothing more."""
    devices = [{**one, "state": one["state"].lower()} for one in told]
    if as_json:
        lines = [json.dumps({"devices": devices, "daemon": "does not answer"})]
    else:
        lines = [f"{one['name']}: told to stop while {one['state']}" for one in devices]
        lines.append("the daemon does not answer")
    os.write(1, "".join(f"{line}\n" for line in lines).encode())
