"""A stop by the way of its own: a small socket beside the daemon's, which nothing else can block.

What listens there writes into the servos' memory by itself; the daemon may hang.  See
:mod:`orientd.daemon.stops.process` for what is said.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
from pathlib import Path
from typing import Any

from orientd.errors import AccessError, DaemonError, RequestError, UnknownNameError
from orientd.first_stop import TIMEOUT, connected
from orientd.rpc.trust import check_folder, check_peer

_ANSWER_BYTES = 1 << 20


def stop_socket(socket_path: Path) -> Path:
    """Return where stops are taken of the daemon that listens at *socket_path*."""
    return socket_path.with_name(f"{socket_path.name}.stop")


def ask_to_stop(
    socket_path: Path, kind: str, device: str = "", *, begun: int = -1
) -> list[dict[str, Any]] | None:
    """Have devices stopped; return what each was doing, or ``None`` where there is no such way.

    Args:
        socket_path: of the daemon.
        kind: ``stop``, or ``halt`` for the quickest, off the path.
        device: its name; empty for all of them.
        begun: the connection by which that was asked already; see :mod:`orientd.first_stop`.

    Returns:
        Of each device ``name``, ``state`` and ``motion`` as the stop met them.

    Raises:
        AccessError: this user is not admitted.
        UnknownNameError: there is no such device.
        DaemonError: a servo, or what listens there, does not answer.
    """
    answer = _answer(stop_socket(socket_path), {"kind": kind, "device": device}, begun)
    if answer is None:
        return None
    if "refused" in answer:
        raise AccessError(f"the daemon at {socket_path} refuses: {answer['refused']}")
    if "unknown" in answer:
        raise UnknownNameError("device", str(answer["unknown"]))
    devices = answer.get("devices")
    if not isinstance(devices, list):
        raise RequestError("", f"the stop was not understood: {answer}")
    silent = [one["name"] for one in devices if one["state"] is None]
    if silent:
        stopped = ", ".join(one["name"] for one in devices if one["state"] is not None)
        rest = f"; told to stop: {stopped}" if stopped else ""
        raise DaemonError(f"no servo of {', '.join(silent)} answers the {kind}{rest}")
    return devices


def refusal(socket_path: Path) -> str:
    """Return why this user is not admitted to the daemon at *socket_path*; empty if they are."""
    try:
        answer = _answer(stop_socket(socket_path), {"kind": "hello"}) or {}
    except AccessError as error:
        return str(error)
    except DaemonError:
        return ""  # it is going away itself
    return str(answer.get("refused", ""))


def _answer(path: Path, request: dict[str, str], begun: int = -1) -> dict[str, Any] | None:
    try:
        descriptor = begun if begun >= 0 else connected(str(path)).detach()
    except PermissionError as error:
        raise AccessError(f"{path} does not admit user {os.geteuid()}") from error
    except OSError:
        return None
    with socket.socket(fileno=descriptor) as connection:
        connection.settimeout(TIMEOUT)
        check_folder(path.absolute().parent)
        check_peer(path, connection)
        try:
            if begun < 0:
                # Whoever is refused is answered, and hung up on, before they say anything.
                with contextlib.suppress(BrokenPipeError):
                    connection.sendall(json.dumps(request).encode() + b"\n")
            with connection.makefile("rb") as incoming:
                answer = json.loads(incoming.readline(_ANSWER_BYTES))
        except (OSError, ValueError) as error:
            raise DaemonError(f"what takes stops at {path} does not answer") from error
    return answer if isinstance(answer, dict) else None
