"""An emulated gimbal or arm and a daemon that drives it, each started by its command."""

import contextlib
import signal
import subprocess
import time
from pathlib import Path

import harness
from command_line import begin
from harness import run_first, until
from reference.wire import PtyTee

from orientd import connect
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb

ROOT = Path(__file__).parents[2]

# A busy machine lets any process wait for a second: that is no fault here.
STALLS = "stall_timeout = 5.0\nheartbeat_timeout = 5.0\n"
STEADY = f"{STALLS}feedback_timeout = "
PATIENT = (
    ("max_losses = 10 ", "max_losses = 100 "),
    ("latency_ms = 16.0 ", "latency_ms = 100.0 "),
    ("feedback_timeout = 0.3 ", f"{STEADY}5.0 "),
    ("watchdog_ms = 500 ", "watchdog_ms = 2000 "),
)


class BusProcess:
    """``orientd sim dynamixel`` with its console."""

    def __init__(self, link, *arguments):
        self._process = begin("sim", "dynamixel", "--link", link, "--console", *arguments,
                              stdin=subprocess.PIPE)  # fmt: skip
        line = self._process.stdout.readline()
        assert line.startswith("ready"), (line, self._process.stderr.read())
        run_first(self._process.pid)

    def ask(self, command):
        """Have a command carried out; return the answer."""
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()

    def end(self, number):
        """End it by a signal and return its status."""
        if self._process.poll() is None:
            self._process.send_signal(number)
        status = self._process.wait(10)
        for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
            stream.close()
        return status


class Terminals:
    """How tests reach serial lines: here real ones.  A world in virtual time has its own."""

    start_bus = BusProcess
    tap = PtyTee


TERMINALS = Terminals()


def tap(link, behind):
    """Return a reader of what is written at *link*, which leads to *behind*."""
    return TERMINALS.tap(link, behind)


class EmulatedGimbal:
    """An emulated bus at *link*, with its console."""

    def __init__(self, link, *arguments):
        self.link = link
        self._bus = TERMINALS.start_bus(link, *arguments)

    def tell(self, command):
        """Have a command carried out; return what it answered."""
        answer = self._bus.ask(command)
        assert answer.startswith(f"done: {command}"), answer
        return answer.removeprefix(f"done: {command}").removeprefix(": ")

    def state(self, servo):
        """Return a servo's registers by name."""
        pairs = (pair.split() for pair in self.tell(f"state {servo}").split(", "))
        return {name: int(value) for name, value in pairs}

    def end(self, number=signal.SIGTERM):
        """End it and return its status."""
        return self._bus.end(number)


SLOW_MACHINE = (
    ('driver = "ur"\n', f'driver = "ur"\n{STALLS}'),
    ("feedback_timeout = 0.1 ", "feedback_timeout = 1.0 "),
    ("link_timeout = 0.5 ", "link_timeout = 2.0 "),
    ("watchdog_hz = 10 ", "watchdog_hz = 1 "),
)


def seldom(condition):
    """Return the condition as it is looked at 20 times a second: more would keep daemons busy."""

    def look():
        time.sleep(0.05)
        return condition()

    return look


def await_hold(daemon, device):
    """Wait until a device holds: on a busy machine an emulated one may answer too late at first."""
    with connect(daemon.socket) as robot:

        def holds():
            if robot.state().devices[device].state == pb.STATE_FAULT:
                with contextlib.suppress(OrientdError):
                    robot.reset(device)
            return robot.state().devices[device].state == pb.STATE_HOLDING

        until(seldom(holds), f"the {device} to hold")


class ExampleDaemon:
    """``orientd run`` with an example configuration, changed where need be."""

    def __init__(self, folder, example, *changes):
        self.folder = Path(folder)
        self.socket = self.folder / "control.sock"
        self.config = self.folder / example
        text = (ROOT / "config" / example).read_text()
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        self.config.write_text(f'[daemon]\nsocket = "{self.socket}"\n{text}')
        self.arguments, self.prefix = ("--config", str(self.config)), ()
        self.environment = {}

    def start(self):
        """Start it and wait until it is ready, or until it says that it is not."""
        self.log = (self.folder / "log").open("ab")
        self.process = harness.MACHINE.start_daemon(self)
        return self

    def end(self, number=signal.SIGTERM):
        """End it and return its status and what it logged."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        self.process.communicate(timeout=30)
        self.log.close()
        return self.process.returncode, (self.folder / "log").read_text()


class GimbalDaemon(ExampleDaemon):
    """The example gimbal on a port of its own."""

    def __init__(self, folder, port, *changes):
        patience = PATIENT if harness.MACHINE.is_patient else ()
        super().__init__(folder, "gimbal.toml", ('/tmp/gimbal"', f'{port}"'), *patience, *changes)
        self.report = self.folder / "state" / "orientd" / "servo-gimbal.json"
