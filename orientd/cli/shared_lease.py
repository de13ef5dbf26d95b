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

from orientd.rpc import Robot, connect


@contextlib.contextmanager
def shared(robot: Robot) -> Iterator[None]:
    """Let other terminals of the same user command under the lease of *robot*.

    The lease of another move of theirs is taken over, which must not end it when it ends.

    Raises:
        LeaseError: somebody else holds the lease.
    """
    path = _token_path(robot.socket)
    token, _ = _read(path)
    if not (token and robot.adopt_lease(token)):
        robot.acquire_lease()
    # Where the directory cannot be written to, the other terminals have to do without.
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(f"{robot.lease_token} {os.getpid()}")
    try:
        yield
    finally:
        _, keeper = _read(path)
        if keeper in ("", str(os.getpid())):
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
        else:
            robot.forsake_lease()


@contextlib.contextmanager
def commander(socket: Path | None, holder: str) -> Iterator[Robot]:
    """Connect to the daemon, under the lease of a running move if there is one."""
    with connect(socket, holder=holder) as robot:
        borrow(robot)
        yield robot


def borrow(robot: Robot) -> bool:
    """Have *robot* command under the lease of a running move; return whether there is one."""
    token, _ = _read(_token_path(robot.socket))
    return bool(token) and robot.borrow_lease(token)


def _token_path(socket: Path) -> Path:
    return socket.with_name(f"{socket.name}.lease")


def _read(path: Path) -> tuple[str, str]:
    """Return the token and who keeps it, both empty where there is none."""
    try:
        token, keeper = path.read_text(encoding="ascii").split()
    except (OSError, UnicodeDecodeError, ValueError):
        return "", ""
    return token, keeper
