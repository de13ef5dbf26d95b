"""A small dashboard client: one line out, one line back, never waiting for ever."""

from __future__ import annotations

import socket
import time
from types import TracebackType
from typing import Self

from orientd.errors import LinkError
from orientd_ur.sockets import DASHBOARD_PORT


class Dashboard:
    """The dashboard server of one robot, connected inside a ``with`` block.

    Args:
        host: the robot's address.
        timeout: s that connecting and each whole answer may take, however many bytes come of it.
    """

    def __init__(self, host: str, *, timeout: float = 0.4) -> None:
        self._host = host
        self._timeout = timeout
        self._sock: socket.socket | None = None
        self._pending = b""

    def __enter__(self) -> Self:
        try:
            self._sock = socket.create_connection((self._host, DASHBOARD_PORT), self._timeout)
        except OSError as error:
            raise LinkError(f"no dashboard server at {self._host}: {error}") from error
        try:
            self._line("its greeting")
        except LinkError:
            self._sock.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._sock is not None:
            self._sock.close()
            self._sock = None

    def ask(self, command: str) -> str:
        """Send *command* and return the answer.

        Raises:
            LinkError: no answer came.
        """
        if self._sock is None:
            raise LinkError("the dashboard is not connected")
        try:
            self._sock.sendall(command.encode() + b"\n")
        except OSError as error:
            raise LinkError(f"the dashboard server at {self._host} is gone: {error}") from error
        return self._line(f"an answer to {command!r}")

    @property
    def version(self) -> str:
        """The text of the robot's software version."""
        return self.ask("PolyscopeVersion")

    @property
    def is_remote(self) -> bool:
        """Whether the robot is in remote control."""
        return "true" in self.ask("is in remote control").lower()

    def _line(self, awaited: str) -> str:
        if self._sock is None:
            raise LinkError("the dashboard is not connected")
        ends = time.monotonic() + self._timeout
        while b"\n" not in self._pending:
            try:
                # Never 0, which would mean not to wait, and never to time out.
                self._sock.settimeout(max(ends - time.monotonic(), 1e-6))
                chunk = self._sock.recv(4096)
            except OSError as error:
                raise LinkError(
                    f"the dashboard server at {self._host} did not send {awaited}: {error}"
                ) from error
            if not chunk:
                raise LinkError(f"the dashboard server at {self._host} closed the connection")
            self._pending += chunk
        line, _, self._pending = self._pending.partition(b"\n")
        return line.decode("utf-8", "replace").strip()
