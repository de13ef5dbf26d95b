"""A small dashboard client: one line out, one line back, never waiting for ever."""

from __future__ import annotations

from orientd.errors import LinkError
from orientd_ur.wire import DASHBOARD_PORT, Connection


class Dashboard(Connection):
    """A connection to the dashboard server of one robot; a context manager.

    Args:
        host: the robot's address.
        timeout: s that connecting and each whole answer may take.

    Raises:
        LinkError: nothing answers there.
    """

    def __init__(self, host: str, *, timeout: float = 0.4) -> None:
        super().__init__(host, DASHBOARD_PORT, "dashboard server", timeout)
        try:
            self.receive(_line, "its greeting")
        except LinkError:
            self.sock.close()
            raise

    def ask(self, command: str) -> str:
        """Send *command* and return the answer.

        Raises:
            LinkError: no answer came.
        """
        self.send(command.encode() + b"\n")
        return self.receive(_line, f"an answer to {command!r}")

    @property
    def is_remote(self) -> bool | None:
        """Whether the robot is in remote control; ``None`` if it does not know the question."""
        answer = self.ask("is in remote control").lower()
        return True if "true" in answer else False if "false" in answer else None


def _line(stream: bytes) -> tuple[str, bytes] | None:
    line, end, rest = stream.partition(b"\n")
    return (line.decode("utf-8", "replace").strip(), rest) if end else None
