"""The client library's sockets, found among the process's own descriptors."""

from __future__ import annotations

import contextlib
import os
import socket
from pathlib import Path

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003


def send_at_once(host: str) -> frozenset[int]:
    """Set ``TCP_NODELAY`` on every connection to the robot's RTDE and script ports.

    The library sets it and then connects in a way that opens the socket anew, which loses it: then
    a setpoint waits for the acknowledgement of the one before.

    Returns:
        The local ports of these connections, by which they can be told from later ones.
    """
    addresses = {info[4][0] for info in socket.getaddrinfo(host, None, socket.AF_INET)}
    found: set[int] = set()
    for entry in os.listdir("/proc/self/fd"):  # noqa: PTH208 - names are all that is needed
        # What is no socket, or gone since it was listed, is none of ours.
        with contextlib.suppress(OSError):
            if not str(Path("/proc/self/fd", entry).readlink()).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry))) as copy:
                peer = copy.getpeername() if copy.family == socket.AF_INET else ("", 0)
                if peer[0] in addresses and peer[1] in (RTDE_PORT, SCRIPT_PORT):
                    copy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    found.add(copy.getsockname()[1])
    return frozenset(found)
