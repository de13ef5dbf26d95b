"""The connection of a command, with the lease of the device that it commands."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from orientd.rpc import Robot, connect


def connect_as(socket: Path | None, command: str) -> Robot:
    """Connect to the daemon; others are told of the *command* if they are refused because of it."""
    return connect(socket, holder=f"orientd {command}, process {os.getpid()}")


@contextlib.contextmanager
def commander(
    socket: Path | None, command: str, device: str, *, is_beside: bool
) -> Iterator[Robot]:
    """Connect to the daemon, and hold the lease of a device meanwhile.

    Args:
        socket: of the daemon.
        command: what others are told of.
        device: its name; may be empty where there is one only.
        is_beside: whether to command beside what the same user runs in another terminal.

    Raises:
        LeaseError: somebody else holds the lease.
    """
    with connect_as(socket, command) as robot:
        robot.acquire_lease(device, beside=is_beside)
        yield robot
