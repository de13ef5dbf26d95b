"""A client of the controller's RTDE port on a plain socket, for what the library does not do."""

from __future__ import annotations

import math
import socket
import time

from orientd.errors import LinkError
from orientd_ur import rtde
from orientd_ur.sockets import RTDE_PORT


class RtdeClient:
    """A connection that gives up after a while; a context manager.

    Args:
        host: the robot's address.
        timeout: s that connecting and each answer may take.
        total: s that all of it may take.

    Raises:
        LinkError: nothing answers, or something that does not speak the protocol.

    Attributes:
        sock: the socket.
    """

    def __init__(self, host: str, timeout: float, *, total: float = math.inf) -> None:
        self._where = f"{host}:{RTDE_PORT}"
        self._timeout = timeout
        self._ends = time.monotonic() + total
        self._pending = b""
        try:
            self.sock = socket.create_connection((host, RTDE_PORT), timeout)
        except OSError as error:
            raise LinkError(f"nothing answers at {self._where}: {error}") from error

    def __enter__(self) -> RtdeClient:
        try:
            accepted = self.ask(rtde.version_request())
            if accepted != b"\x01":
                raise LinkError(f"{self._where} does not speak version 2 of RTDE")
        except LinkError:
            self.sock.close()
            raise
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        self.sock.close()
        if isinstance(error, ValueError):
            raise LinkError(f"{self._where} does not answer what was asked: {error}") from error

    def ask(self, request: bytes) -> bytes:
        """Send *request* and return the payload of its answer."""
        try:
            self.sock.sendall(request)
        except OSError as error:
            raise LinkError(f"{self._where} is gone: {error}") from error
        return self.await_kind(request[2])

    def await_kind(self, kind: int) -> bytes:
        """Return the payload of the next package of *kind*."""
        ends = min(time.monotonic() + self._timeout, self._ends)
        while True:
            try:
                taken = rtde.take(self._pending)
                if taken is not None:
                    got, payload, self._pending = taken
                    if got == kind:
                        return payload
                    continue
                left = ends - time.monotonic()
                if left <= 0.0:
                    raise TimeoutError("timed out")
                self.sock.settimeout(left)
                chunk = self.sock.recv(65536)
            except (OSError, ValueError) as error:
                what = "data packages" if kind == rtde.DATA else f"an answer to {chr(kind)!r}"
                raise LinkError(f"{self._where} accepts, but {what} did not come: {error}") from (
                    error
                )
            if not chunk:
                raise LinkError(f"{self._where} closed the connection")
            self._pending += chunk
