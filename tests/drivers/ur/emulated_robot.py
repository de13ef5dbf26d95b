"""Start an emulated robot in a process of its own, and talk to its control channel.

A client library that holds the interpreter's lock while it connects would wait for ever for an
emulator in a thread of its own process; therefore a process.
"""

import argparse
import json
import select
import signal
import socket
import subprocess
import sys
import time

from orientd_sim.ur import MODELS, Behaviour, serve, version_of
from orientd_sim.ur.server import FAULTS_PORT
from orientd_sim.ur.variables import ProgramState


class LaunchError(Exception):
    """The emulator did not start, or did not answer."""


class EmulatedRobot:
    """An emulated robot, alive inside a ``with`` block.

    Args:
        host: its address.
        options: further words of the command line of this file.
        timeout: s within which it must be ready.
    """

    def __init__(self, host, *options, timeout=20.0):
        self.host = host
        self._options = options
        self._timeout = timeout
        self._process = None
        self._channel = None

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.end()

    @property
    def process(self):
        """The running process.

        Raises:
            LaunchError: it was not started.
        """
        if self._process is None:
            raise LaunchError("the emulated robot was not started")
        return self._process

    def start(self):
        """Start the process and wait for its line.

        Raises:
            LaunchError: it ended, or did not become ready in time.
        """
        process = subprocess.Popen(
            [sys.executable, __file__, "--host", self.host, *self._options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self._process = process
        ready, _, _ = select.select([process.stdout], [], [], self._timeout)
        line = process.stdout.readline() if ready else b""
        if not line.startswith(b"ready"):
            process.kill()
            said = process.stderr.read().decode(errors="replace")
            self.end()
            raise LaunchError(f"the emulated robot at {self.host} did not start: {said.strip()}")

    def end(self):
        """End the process and wait for it."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None
        if self._process is not None:
            process, self._process = self._process, None
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            for stream in (process.stdin, process.stdout, process.stderr):
                stream.close()

    def ask(self, line):
        """Send one line of :mod:`orientd_sim.ur.faults` and return the answer.

        Raises:
            LaunchError: the answer is an error, or none came.
        """
        if self._channel is None:
            self._channel = socket.create_connection((self.host, FAULTS_PORT), timeout=10.0)
        self._channel.sendall(line.encode() + b"\n")
        answer = b""
        while not answer.endswith(b"\n"):
            chunk = self._channel.recv(65536)
            if not chunk:
                self._channel.close()
                self._channel = None
                if line == "die":
                    return "ok"
                raise LaunchError(f"no answer to {line!r}")
            answer += chunk
        text = answer.decode().strip()
        if text.startswith("error"):
            raise LaunchError(text)
        return text

    def state(self):
        """Return the robot's state."""
        return json.loads(self.ask("state"))

    def wait_until(self, claim, *, timeout=10.0):
        """Ask for the state until *claim* holds of it; return that state.

        Raises:
            LaunchError: it does not come to hold in time.
        """
        ends = time.monotonic() + timeout
        while True:
            state = self.state()
            if claim(state):
                return state
            if time.monotonic() > ends:
                raise LaunchError(f"still not so after {timeout} s: {state}")


def main():
    """Be the emulated robot until the input ends, as it does with whoever started it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", required=True, help="an address of this machine")
    parser.add_argument("--model", choices=sorted(MODELS), default="ur5e")
    parser.add_argument("--polyscope", metavar="VERSION", help="as in 5.12.6")
    parser.add_argument(
        "--protective-stop-leaves", choices=("paused", "playing", "stopped"), default="paused",
        help="what a protective stop makes of the program",
    )  # fmt: skip
    parser.add_argument("--unlock-after", type=float, default=5.0, metavar="SECONDS")
    parser.add_argument("--no-breach-stop", action="store_true", help="clamp fast joints only")
    arguments = parser.parse_args()
    model = MODELS[arguments.model]
    behaviour = Behaviour(
        model=model,
        version=version_of(model, arguments.polyscope),
        protective_stop_leaves=ProgramState[arguments.protective_stop_leaves.upper()],
        unlock_after=arguments.unlock_after,
        stops_on_breach=not arguments.no_breach_stop,
    )
    try:
        serve(arguments.host, behaviour, lifeline=0)
    except OSError as error:
        sys.exit(f"cannot serve on {arguments.host}: {error}")


if __name__ == "__main__":
    main()
