"""A UR robot in virtual time: the emulated controller on the sockets of this world.

The client library is C++ with threads of its own.  ``rtde_receive`` and ``rtde_control`` have its
interface here, and speak to the controller as it does: RTDE, registers, and a control program.
"""

# ruff: noqa: N802 - the names are the library's

from __future__ import annotations

import contextlib
import importlib
import struct
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

from processes import Process
from robot_sockets import MODULE, create_connection

from emulated_ur import EmulatedRobot, LaunchError
from emulated_ur import __main__ as program
from emulated_ur import connection as emulated_connection
from emulated_ur import process as emulated_process
from emulated_ur import server as emulated_server
from orientd_ur import driver, link, wire

PROGRAM = Path(__file__).with_name("control_program.script").read_text()
RTDE_PORT, SCRIPT_PORT = 30004, 30003
ANSWERED, READY_LIMIT, PLAYING_LIMIT, POLL = 2.0, 3.0, 5.0, 0.001
READY, DONE = 1, 2
"""What the control program says of itself in its output register."""

REALTIME = {"servoJ": 11, "servoL": 24}
AWAITED = {"servoStop": 16, "setPayload": 17, "teachMode": 18, "endTeachMode": 19, "setTcp": 29,
           "setWatchdog": 35}  # fmt: skip
STOP_SCRIPT, DOUBLES = 255, 11
GETTERS = {
    "Timestamp": "timestamp",
    "RobotMode": "robot_mode",
    "SafetyMode": "safety_mode",
    "RuntimeState": "runtime_state",
    "ActualTCPPose": "actual_TCP_pose",
    "TargetTCPPose": "target_TCP_pose",
    "ActualTCPSpeed": "actual_TCP_speed",
    "ActualQ": "actual_q",
    "TargetQ": "target_q",
    "SpeedScaling": "speed_scaling",
    "TargetSpeedFraction": "target_speed_fraction",
}
_FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I"}


class _Packages:
    """A connection to the RTDE server, and the packages on it.

    Raises:
        OSError: no controller answers there.
    """

    def __init__(self, host):
        self._sock = create_connection((host, RTDE_PORT), ANSWERED)
        self._pending = b""
        self.close, self.settimeout = self._sock.close, self._sock.settimeout

    def send(self, kind, payload=b""):
        self._sock.sendall(struct.pack(">Hc", 3 + len(payload), kind) + payload)

    def ask(self, kind, payload=b""):
        """Send a package, and return the contents of the answer."""
        self.send(kind, payload)
        while True:
            for found, content in self.receive():
                if found == kind:
                    return content

    def receive(self):
        """Yield kinds and contents of the packages that have arrived; wait for bytes first."""
        chunk = self._sock.recv(65536)
        if not chunk:
            raise ConnectionResetError("the controller closed the connection")
        self._pending += chunk
        while len(self._pending) >= 3 and len(self._pending) >= (size := self._size()):
            package, self._pending = self._pending[:size], self._pending[size:]
            yield package[2:3], package[3:]

    def _size(self):
        size = int.from_bytes(self._pending[:2], "big")
        if size < 3:
            raise ConnectionAbortedError("the controller does not speak RTDE")
        return size


class Session:
    """A session with the RTDE server: variables as they come, and registers to write."""

    def __init__(self, host, variables, inputs=()):
        try:
            self._packages = packages = _Packages(host)
            self._newest, self._kinds = {}, []
            packages.ask(b"V", struct.pack(">H", 2))
            version = struct.unpack(">4I", packages.ask(b"v"))
            self._recipe = self._claim(inputs) if inputs else b""
            rate = struct.pack(">d", 500.0 if version[0] >= 5 else 125.0)
            answer = packages.ask(b"O", rate + ",".join(variables).encode())
            kinds = [_FORMATS[kind] for kind in answer[1:].decode().split(",")]
            self._kinds = list(zip(variables, kinds, strict=True))
            packages.ask(b"S")
        except OSError as error:
            raise RuntimeError(f"{host}: {error}") from error
        self.is_connected, self.close = True, packages.close
        packages.settimeout(None)
        threading.Thread(target=self._listen, name="rtde", daemon=True).start()
        while not self._newest:
            time.sleep(POLL)

    def _claim(self, inputs):
        answer = self._packages.ask(b"I", ",".join(inputs).encode())
        if b"IN_USE" in answer:
            self._packages.close()
            raise RuntimeError("One of the RTDE input registers are already in use!")
        return answer[:1]

    def _listen(self):
        """Take packages until the connection ends."""
        with contextlib.suppress(OSError):
            while True:
                for kind, content in self._packages.receive():
                    if kind == b"U":
                        self._newest = self._read(content)
        self.is_connected = False

    def _read(self, content):
        found, at = {}, 1
        for name, kind in self._kinds:
            values = struct.unpack_from(f">{kind}", content, at)
            at += struct.calcsize(f">{kind}")
            found[name] = list(values) if len(values) > 1 else values[0]
        return found

    def __getitem__(self, name):
        return self._newest[name]

    def write(self, command, values=()):
        """Write a command and its numbers into the registers."""
        numbers = [*map(float, values), *[0.0] * (DOUBLES - len(values))]
        packed = self._recipe + struct.pack(f">i{DOUBLES}d", command, *numbers)
        try:
            self._packages.send(b"U", packed)
        except OSError as error:
            self.is_connected = False
            raise RuntimeError(f"the connection is gone: {error}") from error


class RTDEReceiveInterface:
    """``rtde_receive.RTDEReceiveInterface``."""

    def __init__(self, host, _frequency, variables):
        self._session = Session(host, variables)
        self.disconnect = self._session.close

    def isConnected(self):
        return self._session.is_connected

    def __getattr__(self, name):
        variable = GETTERS[name.removeprefix("get")]
        return lambda: self._session[variable]


class ControlProgram:
    """The control program on the controller, and the registers that it reads.

    Attributes:
        session: with the registers.
    """

    def __init__(self, host, offset):
        self._host, self._offset = host, offset
        self._state = f"output_int_register_{offset}"
        doubles = (f"input_double_register_{offset + k}" for k in range(DOUBLES))
        self.session = Session(
            host,
            ["robot_status_bits", "safety_status_bits", self._state],
            [f"input_int_register_{offset}", *doubles],
        )
        self.session.write(0)

    @property
    def is_running(self):
        return bool(self.session["robot_status_bits"] & 2)

    @property
    def is_stopped(self):
        """Whether no program runs, or a stop holds it."""
        return not self.is_running or self.session["safety_status_bits"] & (1 << 2 | 1 << 7)

    def says(self, state, seconds):
        """Wait until the program says so of itself; return whether it did."""
        return self.wait(lambda: self.session[self._state] == state, seconds)

    def upload(self):
        """Play the control program, in place of one that plays."""
        if self.is_running:
            self.stop()
        with create_connection((self._host, SCRIPT_PORT), ANSWERED) as script:
            script.sendall(PROGRAM.replace("OFFSET", str(self._offset)).encode())
        if not self.wait(lambda: self.is_running, PLAYING_LIMIT):
            raise RuntimeError("Failed to start control script, before timeout of 5 seconds")
        return True

    def stop(self):
        self.says(READY, READY_LIMIT)
        self.session.write(STOP_SCRIPT)
        self.wait(lambda: not self.is_running, READY_LIMIT)
        self.session.write(0)

    def wait(self, is_so, seconds):
        """Wait until something is so; give up if the robot has stopped."""
        ends = time.monotonic() + seconds
        is_start = seconds == PLAYING_LIMIT
        while not is_so():
            if not self.session.is_connected:
                raise RuntimeError("the connection is gone")
            if self.is_stopped and not is_start:
                return False
            if time.monotonic() > ends:
                return False
            time.sleep(POLL)
        return True


class RTDEControlInterface:
    """``rtde_control.RTDEControlInterface``."""

    FLAG_UPLOAD_SCRIPT, FLAG_UPPER_RANGE_REGISTERS = 1, 8

    def __init__(self, host, _frequency, flags):
        offset = 24 if flags & self.FLAG_UPPER_RANGE_REGISTERS else 0
        self._program = ControlProgram(host, offset)
        self._session = self._program.session
        self.disconnect = self._session.close
        self.reuploadScript, self.stopScript = self._program.upload, self._program.stop
        self.reuploadScript()

    def isConnected(self):
        return self._session.is_connected

    def isProgramRunning(self):
        return self._program.is_running

    def kickWatchdog(self):
        self._session.write(0)
        return True

    def __getattr__(self, name):
        number = REALTIME.get(name) or AWAITED[name]
        return lambda *arguments: self._carry_out(number, arguments, name in AWAITED)

    def _carry_out(self, number, arguments, is_awaited):
        """Have the program carry out a command, if it plays and nothing has stopped the robot."""
        values = []
        for one in arguments:
            values += one if isinstance(one, list) else [one]
        if self._program.is_stopped or not self._program.says(READY, READY_LIMIT):
            self._session.write(0)
            return False
        self._session.write(number, values)
        if is_awaited:
            is_done = self._program.says(DONE, 300.0)
            self._session.write(0)
            return is_done
        return True


class RobotProcess(Process):
    """An emulated robot: its server, in a task of this world."""

    def __init__(self, world, host, behaviour):
        scheduler = world.scheduler
        super().__init__(scheduler, "robot")
        self._server, self.problem = None, ""
        world.add(self)
        scheduler.spawn(lambda: self._serve(host, behaviour), "robot", self.group)
        while self._server is None and not self.problem:
            scheduler.sleep(POLL)

    def _serve(self, host, behaviour):
        try:
            self._server = emulated_server.Server(host, behaviour)
        except OSError as error:
            self.problem = str(error)
            return
        self._server.run()

    def communicate(self, timeout=None):
        self.wait(timeout)
        return b"", b""

    def _receive(self, number):
        task = self._scheduler.current()
        is_own = task is not None and task.group == self.group
        self._server.close()
        super()._receive(number)
        if is_own:
            self._scheduler.hub.switch()  # whoever kills itself does not go on


def _start(world, robot):
    """Start an emulated robot, in place of :meth:`EmulatedRobot.start`."""
    found = []

    def serve(host, behaviour, lifeline):
        found.append(RobotProcess(world, host, behaviour))

    words = ["emulated-ur", "--host", robot.host, *robot._options]
    with mock.patch.object(program, "serve", serve), mock.patch.object(sys, "argv", words):
        program.main()
    if found[0].problem:
        raise LaunchError(f"the emulated robot did not start: {found[0].problem}")
    robot._process = found[0]
    return robot


def of_robots(world):
    """Return what drivers, tests and the emulator find in a world."""
    library = {
        "rtde_receive": SimpleNamespace(RTDEReceiveInterface=RTDEReceiveInterface),
        "rtde_control": SimpleNamespace(RTDEControlInterface=RTDEControlInterface),
    }

    def unlimited(_seconds):
        return contextlib.nullcontext()

    modules = SimpleNamespace(import_module=library.__getitem__, util=importlib.util)
    users = (emulated_server, emulated_connection, emulated_process, wire)
    return [
        (EmulatedRobot, "start", lambda robot: _start(world, robot)),
        (link, "importlib", modules),
        (link, "send_at_once", lambda _address: frozenset()),
        (link, "process_ends_after", unlimited),
        (driver, "alarm_after", unlimited),
        *((user, "socket", MODULE) for user in users),
    ]
