"""When the controller's packages arrive, by the kernel's clock and nobody's scheduling.

The client library says what came, not when.  So a connection of our own asks for nothing but the
timestamp, and the kernel writes down when each package came in.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from orientd.errors import LinkError
from orientd_ur import rtde
from orientd_ur.rtde_client import RtdeClient

FREQUENCY = 25.0
"""Packages a second; a divisor of every controller's rate."""

# Not named by Python's socket module; the same on every architecture that robots are driven from.
_SO_TIMESTAMPNS = 35
_TIME = struct.Struct("@qq")
_SPACE = socket.CMSG_SPACE(_TIME.size)


class TickListener:
    """A connection that is told the controller's time, alive until :meth:`close`.

    Args:
        host: the robot's address.
        timeout: s that connecting and each answer may take.

    Raises:
        LinkError: the robot does not answer.
    """

    def __init__(self, host: str, *, timeout: float = 2.0) -> None:
        client = RtdeClient(host, timeout).__enter__()
        self._sock = client.sock
        try:
            client.ask(rtde.outputs_request(FREQUENCY, ("timestamp",)))
            self._sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            client.ask(rtde.package(rtde.START))
        except (LinkError, OSError) as error:
            self._sock.close()
            raise LinkError(f"{host} does not tell its time: {error}") from error
        self._sock.setblocking(False)
        self._pending = b""
        self._is_deaf = False
        self._arrived_ns: int | None = None

    def heard(self) -> tuple[float, int] | None:
        """Return a new timestamp (s) and when it arrived (ns, monotonic clock), if there is one.

        Never waits, never raises: once the connection is gone there is nothing new.
        """
        if self._is_deaf:
            return None
        try:
            chunk, notes, _, _ = self._sock.recvmsg(4096, _SPACE)
            timestamps = self._timestamps(chunk)
        except BlockingIOError:
            return None
        except (OSError, ValueError):
            self._is_deaf = True
            return None
        arrived = [_TIME.unpack(note) for _, kind, note in notes if kind == _SO_TIMESTAMPNS]
        self._is_deaf = not chunk
        if not timestamps or not arrived:
            return None
        seconds, nanoseconds = arrived[0]
        age_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
        self._arrived_ns = time.monotonic_ns() - age_ns
        return timestamps[-1], self._arrived_ns

    def silence_ns(self) -> int | None:
        """Return how long ago the newest package arrived, by the kernel; ``None`` before any."""
        while self.heard() is not None:
            continue
        return None if self._arrived_ns is None else time.monotonic_ns() - self._arrived_ns

    def close(self) -> None:
        """Close the connection."""
        with contextlib.suppress(OSError):
            self._sock.close()

    def _timestamps(self, chunk: bytes) -> list[float]:
        self._pending += chunk
        found: list[float] = []
        while (taken := rtde.take(self._pending)) is not None:
            kind, payload, self._pending = taken
            if kind == rtde.DATA:
                found.append(rtde.timestamp(payload))
        return found
