"""A small dashboard client: one line out, one line back, never waiting for ever."""

from __future__ import annotations

import socket
import time
from typing import Self

from orientd.errors import LinkError
from orientd_ur.sockets import DASHBOARD_PORT


class Dashboard:
    """A connection to the dashboard server of one robot; a context manager.

    Args:
        host: the robot's address.
        timeout: s that connecting and each whole answer may take, however many bytes come of it.

    Raises:
        LinkError: nothing answers there.
    """

    def __init__(self, host: str, *, timeout: float = 0.4) -> None:
        self._host = host
        self._timeout = timeout
        self._pending = b""
        try:
            self._sock = socket.create_connection((host, DASHBOARD_PORT), timeout)
        except OSError as error:
            raise LinkError(f"no dashboard server at {host}: {error}") from error

    def __enter__(self) -> Self:
        try:
            self._line("its greeting")
        except LinkError:
            self._sock.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._sock.close()

    def ask(self, command: str) -> str:
        """Send *command* and return the answer.

        Raises:
            LinkError: no answer came.
        """
        try:
            self._sock.sendall(command.encode() + b"\n")
        except OSError as error:
            raise LinkError(f"the dashboard server at {self._host} is gone: {error}") from error
        return self._line(f"an answer to {command!r}")

    @property
    def is_remote(self) -> bool | None:
        """Whether the robot is in remote control; ``None`` where it does not know the question."""
        answer = self.ask("is in remote control").lower()
        return True if "true" in answer else False if "false" in answer else None

    def _line(self, awaited: str) -> str:
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
