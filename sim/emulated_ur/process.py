"""An emulated robot in its own process, and its control channel, for tests.

It needs a process: a client library that holds the interpreter's lock while it connects would wait
for ever for an emulator in a thread.
"""

from __future__ import annotations

import json
import random
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

FAULTS_PORT = 29998
_SCRIPT_PORT = 30002


class LaunchError(Exception):
    """The emulator did not start, or did not answer."""


class EmulatedRobot:
    """An emulated robot, alive inside a ``with`` block.

    Args:
        host: its address; by default a free one of 127.0.0.0/8.
        options: further arguments of the command ``emulated-ur``.
        timeout: s within which it must be ready.
    """

    def __init__(self, host: str | None = None, *options: str, timeout: float = 20.0) -> None:
        self.host = host or _free_address()
        self._options = options
        self._timeout = timeout
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> EmulatedRobot:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def process(self) -> subprocess.Popen[bytes]:
        """The running process.

        Raises:
            LaunchError: it was not started.
        """
        if self._process is None:
            raise LaunchError("the emulated robot was not started")
        return self._process

    def start(self) -> EmulatedRobot:
        """Start the process and wait until it is ready; return the robot.

        Raises:
            LaunchError: it ended, or did not become ready in time.
        """
        command = [sys.executable, "-m", "emulated_ur", "--until-end-of-input", "--host", self.host]
        pipe = subprocess.PIPE
        process = subprocess.Popen([*command, *self._options], stdin=pipe, stdout=pipe, stderr=pipe)
        self._process = process
        stdout, stderr = process.stdout, process.stderr
        ready = stdout and select.select([stdout], [], [], self._timeout)[0]
        line = stdout.readline() if ready and stdout else b""
        if not line.startswith(b"ready"):
            process.kill()
            said = stderr.read().decode(errors="replace") if stderr else ""
            self.end()
            raise LaunchError(f"the emulated robot at {self.host} did not start: {said.strip()}")
        return self

    def end(self) -> None:
        """End the process and wait for it."""
        if self._process is not None:
            process, self._process = self._process, None
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
            try:
                process.communicate(timeout=10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()

    def ask(self, line: str) -> str:
        """Send one line of :mod:`emulated_ur.faults` and return the answer.

        Raises:
            LaunchError: the answer is an error, or none came.
        """
        with socket.create_connection((self.host, FAULTS_PORT), timeout=10.0) as link:
            link.sendall(line.encode() + b"\n")
            text = link.makefile().readline().strip()
        if not text and line != "die":
            raise LaunchError(f"no answer to {line!r}")
        if text.startswith("error"):
            raise LaunchError(text)
        return text

    def state(self) -> dict[str, Any]:
        """Return the robot's state."""
        found: dict[str, Any] = json.loads(self.ask("state"))
        return found

    def run(self, script: str) -> None:
        """Send a program or a line of URScript."""
        with socket.create_connection((self.host, _SCRIPT_PORT), timeout=5.0) as link:
            link.sendall(script.encode() + b"\n")

    def wait_until(
        self, claim: Callable[[dict[str, Any]], bool], *, timeout: float = 10.0
    ) -> dict[str, Any]:
        """Wait until *claim* holds for the state; return that state.

        Raises:
            LaunchError: it does not hold in time.
        """
        ends = time.monotonic() + timeout
        while True:
            state = self.state()
            if claim(state):
                return state
            if time.monotonic() > ends:
                raise LaunchError(f"still not so after {timeout} s: {state}")


def _free_address() -> str:
    """Return a free address of 127.0.0.0/8."""
    while True:
        host = "127." + ".".join(str(random.randrange(1, 255)) for _ in range(3))
        with socket.socket() as link:
            if link.connect_ex((host, FAULTS_PORT)):
                return host
