"""An emulated bus in its own process, for tests."""

from __future__ import annotations

import select
import subprocess
import sys
import tempfile
from pathlib import Path


class BusError(Exception):
    """The bus did not start, or refused a command."""


class EmulatedBus:
    """An emulated bus, alive inside a ``with`` block.

    Args:
        servos: ids and models, as in ``1:xm430,2:xl330``.
        options: further arguments of the command ``emulated-dynamixel``.

    Attributes:
        port: the serial port that clients open.
    """

    def __init__(self, servos: str = "1:xm430,2:xm430,3:xm430", *options: str) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="dynamixel-")
        self.port = str(Path(self._folder.name) / "port")
        words = ("--link", self.port, "--servos", servos, "--console", *options)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "emulated_dynamixel", *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        said = self._line(20.0)
        if not said.startswith("ready"):
            self.close()
            raise BusError(f"the emulated bus did not start: {said}")

    def ask(self, command: str) -> str:
        """Execute a command of the console, such as ``jam 2``; return its answer.

        Raises:
            BusError: it is refused.
        """
        print(command, file=self._process.stdin, flush=True)
        said = self._line(5.0)
        if not said.startswith("done"):
            raise BusError(said)
        return said.removeprefix(f"done: {command}").removeprefix(": ")

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.communicate()
        self._folder.cleanup()

    def __enter__(self) -> EmulatedBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _line(self, timeout: float) -> str:
        stream = self._process.stdout
        if stream is None:
            return "it has ended"
        ready, _, _ = select.select([stream], [], [], timeout)
        return stream.readline().strip() if ready else f"no answer within {timeout} s"
