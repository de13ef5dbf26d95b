"""The lease of a running `orientd move`, for the same user's commands in other terminals.

Whoever types `orientd pause --lease` beside a running `orientd move` is the same commander with two
terminals.  The token lies next to the socket, where only the user can read it, for as long as the
motion runs.  Each terminal has a lease of its own of the two: what one of them gives back ends its
own motions, and no others.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from orientd.errors import LeaseError
from orientd.rpc import Robot, connect


def connect_as(socket: Path | None, command: str) -> Robot:
    """Connect to the daemon; others are told of the *command* where they are refused by it."""
    return connect(socket, holder=f"orientd {command}, process {os.getpid()}")


@contextlib.contextmanager
def commander(
    socket: Path | None, command: str, device: str, *, is_beside: bool, is_shared: bool = False
) -> Iterator[Robot]:
    """Connect to the daemon, and hold the lease of a device meanwhile.

    Args:
        socket: of the daemon.
        command: what others are told of.
        device: its name; may be empty where there is one only.
        is_beside: whether to command beside what holds the lease in another terminal, if any does.
        is_shared: whether other terminals may command beside this one.

    Raises:
        LeaseError: somebody else holds the lease.
    """
    with connect_as(socket, command) as robot:
        if is_beside and borrow(robot, device):
            yield robot
            return
        try:
            robot.acquire_lease(device)
        except LeaseError as error:
            if is_beside or not _read(_token_path(robot, device)):
                raise
            raise LeaseError(f"{error}; with --lease, this commands beside it") from error
        with _told(robot, device) if is_shared else contextlib.nullcontext():
            yield robot


def borrow(robot: Robot, device: str) -> bool:
    """Have *robot* command beside a running move of *device*; return whether there is one."""
    token = _read(_token_path(robot, device))
    return bool(token) and robot.borrow_lease(token)


@contextlib.contextmanager
def _told(robot: Robot, device: str) -> Iterator[None]:
    """Let other terminals of the same user find the token."""
    path, token = _token_path(robot, device), robot.lease_token
    # Where the directory cannot be written to, the other terminals have to do without.
    with contextlib.suppress(OSError):
        path.unlink(missing_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(token)
    try:
        yield
    finally:
        if _read(path) == token:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def _token_path(robot: Robot, device: str) -> Path:
    name = "".join(one if one.isalnum() else "_" for one in robot.device_name(device))
    return robot.socket.with_name(f"{robot.socket.name}.lease.{name}")


def _read(path: Path) -> str:
    """Return the token; empty where there is none."""
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
