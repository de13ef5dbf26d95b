"""The lease of a running `orientd move`, for the same user's commands in other terminals.

Whoever types `orientd pause` beside a running `orientd move` is the same commander with two
terminals.  The token lies next to the socket, where only the user can read it, for as long as the
motion runs.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from orientd.rpc.client import Robot, connect


@contextlib.contextmanager
def shared(robot: Robot) -> Iterator[None]:
    """Let other terminals of the same user command under the lease of *robot*.

    Raises:
        LeaseError: somebody else holds the lease.
    """
    robot.acquire_lease()
    path = _token_path(robot.socket)
    # Where the directory cannot be written to, the other terminals have to do without.
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(robot.lease_token)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def commander(socket: Path | None, holder: str) -> Iterator[Robot]:
    """Connect to the daemon, under the lease of a running move if there is one."""
    with connect(socket, holder=holder) as robot:
        token = _read(_token_path(robot.socket))
        if token:
            robot.borrow_lease(token)
        yield robot


def _token_path(socket: Path) -> Path:
    return socket.with_name(f"{socket.name}.lease")


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
