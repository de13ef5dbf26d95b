"""Where the control socket is, and whether a path can be one."""

from __future__ import annotations

import os
from pathlib import Path

from orientd import first_stop
from orientd.errors import DaemonError

# struct sockaddr_un has 108 bytes for the path and its terminating zero.
MAX_PATH_BYTES = 107


def found_socket() -> Path:
    """Return where a daemon is to be found: the user's own, or else the one of the system."""
    return Path(first_stop.found_socket())


def default_socket() -> Path:
    """Return where the daemon is unless the configuration says otherwise."""
    return Path(first_stop.default_socket())


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
