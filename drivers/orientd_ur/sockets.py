"""The robot's address, and the client library's sockets among the process's own descriptors."""

from __future__ import annotations

import contextlib
import os
import queue
import socket
import threading
from pathlib import Path
from typing import NamedTuple

from orientd.errors import LinkError

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003


class Address:
    """The address of a robot, of whose name a resolver is asked once.

    Args:
        host: a name or an address.
    """

    def __init__(self, host: str) -> None:
        self.host = host
        self._known = ""
        with contextlib.suppress(OSError):
            self._known = socket.inet_ntoa(socket.inet_aton(host))

    def get(self, timeout: float) -> str:
        """Return the address; ask for it the first time, for *timeout* s at most.

        Raises:
            LinkError: nobody knows the name, or the resolver does not answer.
        """
        if not self._known:
            # The resolver takes no time limit.  Its answer is kept even when it comes too late.
            answers: queue.SimpleQueue[OSError | UnicodeError | None] = queue.SimpleQueue()
            threading.Thread(target=self._resolve, args=(answers,), daemon=True).start()
            try:
                error = answers.get(timeout=timeout)
            except queue.Empty:
                raise LinkError(
                    f"{self.host}: the name was not resolved in {timeout:g} s"
                ) from None
            if error is not None:
                raise LinkError(f"{self.host}: the name cannot be resolved: {error}") from error
        return self._known

    def _resolve(self, answers: queue.SimpleQueue[OSError | UnicodeError | None]) -> None:
        try:
            found = socket.getaddrinfo(self.host, None, socket.AF_INET)
            self._known = str(found[0][4][0])
            answers.put(None)
        except (OSError, UnicodeError) as error:
            # The latter of names that cannot be asked for: with an empty or too long part.
            answers.put(error)


class OpenSocket(NamedTuple):
    """A socket of this process: its descriptor, and the kernel's number for what is behind it."""

    descriptor: int
    inode: int


def send_at_once(address: str) -> frozenset[OpenSocket]:
    """Set ``TCP_NODELAY`` on every connection to the robot's RTDE and script ports.

    The library sets it and then connects in a way that opens the socket anew, which loses it: then
    a setpoint waits for the acknowledgement of the one before.

    Returns:
        These connections, by which they can be told from later ones.
    """
    found: set[OpenSocket] = set()
    for entry in os.listdir("/proc/self/fd"):  # noqa: PTH208 - names are all that is needed
        # What is no socket, or gone since it was listed, is none of ours.
        with contextlib.suppress(OSError):
            if not str(Path("/proc/self/fd", entry).readlink()).startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(entry))) as copy:
                peer = copy.getpeername() if copy.family == socket.AF_INET else ("", 0)
                if peer[0] == address and peer[1] in (RTDE_PORT, SCRIPT_PORT):
                    copy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    found.add(OpenSocket(int(entry), os.fstat(copy.fileno()).st_ino))
    return frozenset(found)


def are_open(sockets: frozenset[OpenSocket]) -> bool:
    """Whether these are still the sockets they were; asks the kernel, a microsecond each."""
    try:
        return all(os.fstat(one.descriptor).st_ino == one.inode for one in sockets)
    except OSError:
        return False
