"""The fast path of a stop from the shell: find the daemon and send the stop.

Loading modules takes longer than stopping a device.  So the stop goes out before they load.  This
module imports only modules that Python has loaded by itself, and its built-in sockets.  The trust
of the servos' answers is checked afterwards (:mod:`orientd.client.stop_call`): the content of a
stop is not secret.
"""

# ruff: noqa: PTH110, PTH111, PTH116, PTH208, SIM105 - pathlib and contextlib take as long to load

from __future__ import annotations

import _socket
import os
import sys
import time

Answers = dict[str, tuple[str, int]]
"""Each servo's answer to a stop, by device, and the number of its user: -1 without an answer."""

SYSTEM_SOCKET = "/run/orientd/control.sock"
"""Of the daemon that runs as a service of the system."""

TIMEOUT = 1.0
"""Timeout of the servos' answers, s."""

_RETRY = 0.001
"""Pause until a stop is sent again to a servo that has no space for it, s."""

_ANSWER_BYTES = 256

KINDS = ("stop", "halt")

_OPTIONS = {"--socket": "socket", "--device": "device", "-d": "device"}
_FIRST = -20
"""Niceness for a process that comes first, if that is permitted."""


def runtime_directory() -> str:
    """Return the directory of the user's sockets; it may not be there yet.

    ``$XDG_RUNTIME_DIR/orientd``; or the first of ``$RUNTIME_DIRECTORY``, which systemd sets for a
    service; or ``/run/user/<uid>/orientd``; and only where there is none of them
    ``/tmp/orientd-<uid>``.  On Windows ``AppData/Local/orientd`` of the user.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return f"{runtime}/orientd"
    offered = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if offered:
        return offered
    if not hasattr(os, "getuid"):  # Windows
        return os.path.expanduser("~/AppData/Local/orientd")
    of_user = f"/run/user/{os.getuid()}"
    if os.access(of_user, os.W_OK | os.X_OK) and os.stat(of_user).st_uid == os.getuid():
        return f"{of_user}/orientd"
    return f"/tmp/orientd-{os.getuid()}"


def default_socket() -> str:
    """Return the default socket of the daemon."""
    named = os.environ.get("ORIENTD_SOCKET")
    return os.path.expanduser(named) if named else f"{runtime_directory()}/control.sock"


def found_socket() -> str:
    """Return the socket of a daemon: the user's own, or else that of the system."""
    own = default_socket()
    is_named = "ORIENTD_SOCKET" in os.environ
    if not is_named and not os.path.exists(own) and os.path.exists(SYSTEM_SOCKET):
        return SYSTEM_SOCKET
    return own


def plain(arguments: list[str]) -> dict[str, str] | None:
    """Return the stop on a simple command line; ``None`` for any other one.

    Returns:
        ``kind``, ``device`` and the daemon's ``socket``; and ``json`` if it is requested.
    """
    if not arguments or arguments[0] not in KINDS:
        return None
    given = {"kind": arguments[0], "device": "", "socket": ""}
    waiting = iter(arguments[1:])
    for argument in waiting:
        value = "" if argument == "--json" else next(waiting, "")
        name = "json" if argument == "--json" else _OPTIONS.get(argument)
        if name is None or (name != "json" and (not value or value.startswith("-"))):
            return None
        given[name] = value
    named = given["socket"] or os.environ.get("ORIENTD_SOCKET")
    if not named and os.environ.get("ORIENTD_ADDRESS"):
        return None
    return given | {"socket": given["socket"] or found_socket()}


def first(asked: dict[str, str]) -> Answers | None:
    """Send the stop on a simple command line, before anything else.

    Returns:
        As :func:`send`; ``None`` too if this user is not admitted.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, _FIRST)
    except OSError:
        pass
    try:
        return send(asked["socket"], asked["kind"], asked["device"])
    except OSError:
        return None


def stop_folder(socket_path: str) -> str:
    """Return the folder of the servos' stop sockets for the daemon at *socket_path*."""
    return f"{socket_path}.stop"


def send(socket_path: str, kind: str, device: str = "") -> Answers | None:
    """Send a stop to the servos of the daemon at *socket_path*, and wait for their answers.

    No servo waits for another one: one that reads nothing has no space for a stop after a while.

    Args:
        socket_path: of the daemon.
        kind: one of :data:`KINDS`, or ``hello``, which stops nothing.
        device: its name; empty for all of them.

    Returns:
        The answer of each device's servo and the number of its user, -1 for one that does not
        answer; ``None`` if no servo listens.

    Raises:
        OSError: this user may not access the folder.
    """
    try:
        flags = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
        folder = os.open(stop_folder(socket_path), flags)
    except (FileNotFoundError, NotADirectoryError):
        return None
    asking = _socket.socket(_socket.AF_UNIX, _socket.SOCK_DGRAM)
    try:
        asking.bind("")  # to an address of the kernel's choice, for the answers
        asking.setsockopt(_socket.SOL_SOCKET, _socket.SO_PASSCRED, 1)
        unsent = [name for name in os.listdir(folder) if device in ("", name)]
        answers: Answers = dict.fromkeys(unsent, ("", -1))
        end = time.monotonic() + TIMEOUT
        while True:
            asking.settimeout(0.0)
            for name in unsent[:]:
                try:
                    # By way of its folder: that path is never too long.
                    asking.sendto(kind.encode(), f"/proc/self/fd/{folder}/{name}")
                except (ConnectionRefusedError, FileNotFoundError):
                    del answers[name]  # its servo has ended
                except OSError:
                    continue  # no space; it has not answered until it does
                unsent.remove(name)
            left = end - time.monotonic()
            if left <= 0.0 or all(uid >= 0 for _, uid in answers.values()):
                return answers or None
            asking.settimeout(min(left, _RETRY) if unsent else left)
            try:
                answer, ancillary, _, sender = asking.recvmsg(_ANSWER_BYTES, _ANSWER_BYTES)
            except TimeoutError:
                continue
            uid = int.from_bytes(ancillary[0][2][4:8], sys.byteorder)
            answers[str(sender).rpartition("/")[2]] = answer.decode(), uid
    finally:
        asking.close()
        os.close(folder)
