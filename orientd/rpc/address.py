"""Where the control socket is, and whether a path can be one."""

from __future__ import annotations

import os
from pathlib import Path

from orientd.errors import DaemonError

# struct sockaddr_un has 108 bytes for the path and its terminating zero.
MAX_PATH_BYTES = 107

SYSTEM_SOCKET = Path("/run/orientd/control.sock")
"""Of the daemon that runs as a service of the system."""

# A motion of 100,000 keyframes takes some 8 MiB.
MAX_MESSAGE_BYTES = 64 * 1024 * 1024


def runtime_directory() -> Path:
    """Return the directory of the user's sockets; it may not be there yet.

    ``$XDG_RUNTIME_DIR/orientd``; or the first of ``$RUNTIME_DIRECTORY``, which systemd sets for a
    service; or ``/run/user/<uid>/orientd``; and only where there is none of them
    ``/tmp/orientd-<uid>``.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        return Path(runtime) / "orientd"
    offered = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if offered:
        return Path(offered)
    of_user = Path(f"/run/user/{os.getuid()}")
    if os.access(of_user, os.W_OK | os.X_OK) and of_user.stat().st_uid == os.getuid():
        return of_user / "orientd"
    return Path(f"/tmp/orientd-{os.getuid()}")


def found_socket() -> Path:
    """Return where a daemon is to be found: the user's own, or else the one of the system."""
    socket = default_socket()
    if "ORIENTD_SOCKET" not in os.environ and not socket.exists() and SYSTEM_SOCKET.exists():
        return SYSTEM_SOCKET
    return socket


def default_socket() -> Path:
    """Return where the daemon is unless the configuration says otherwise."""
    named = os.environ.get("ORIENTD_SOCKET")
    return Path(named).expanduser() if named else runtime_directory() / "control.sock"


def target(socket: Path) -> str:
    """Return what gRPC calls the Unix domain socket at *socket*.

    Raises:
        DaemonError: the path is too long for a socket.
    """
    path = socket.absolute()
    if not path.as_posix().isprintable():
        raise DaemonError(f"the path of a socket must be text that is shown, got {str(path)!r}")
    size = len(os.fsencode(path))
    if size > MAX_PATH_BYTES:
        raise DaemonError(
            f"the path of a socket has at most {MAX_PATH_BYTES} bytes, {path} has {size}"
        )
    return f"unix:{path}"
