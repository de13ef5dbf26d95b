"""A stand-in for the client library: a robot that a test sets, and what was called."""

import sys
from types import ModuleType, SimpleNamespace

from orientd.clock import ManualClock
from orientd_ur import UrDriver
from orientd_ur.arm import MODELS
from orientd_ur.controller import RuntimeState
from orientd_ur.probe import Probe

HOST = "127.0.0.9"
JOINTS = (0.1, -1.5, 1.4, -1.3, -1.5, 0.2)


class FakeRobot:
    """What the robot is, and how the library behaves."""

    def __init__(self):
        self.timestamp, self.is_frozen = 100.0, False
        self.is_connected = self.is_control_connected = True
        self.late = {}
        self.modes = [7, 1, int(RuntimeState.STOPPED)]
        self.pose = self.target_pose = [0.1, 0.2, 0.3, 0.4, -0.2, 0.1]
        self.speed = [0.0] * 6
        self.joints, self.target_joints = list(JOINTS), list(JOINTS)
        self.scaling, self.fraction = 1.0, 1.0
        self.command = 0
        self.calls = []
        self.answers = {}
        self.refusals = []
        self.dashboard = []
        self.dashboard_answers = {}

    def tick(self):
        """Return the controller's clock, which has gone on unless the robot is frozen."""
        if not self.is_frozen and not self.is_late("timestamp"):
            self.timestamp += 0.002
        return self.timestamp

    def is_late(self, what):
        """Return whether something that is awaited has not come yet, as *late* says of it."""
        self.late[what] = self.late.get(what, 0) - 1
        return self.late[what] >= 0

    def mode(self):
        """Return the robot mode; the arm may need a while until it runs."""
        return 4 if self.modes[0] == 7 and self.is_late("mode") else self.modes[0]

    def is_playing(self):
        return self.modes[2] == RuntimeState.PLAYING and not self.is_late("program")

    def called(self, name):
        return [arguments for called, arguments in self.calls if called == name]

    def install(self, monkeypatch, *, version=(5, 12, 6, 0)):
        """Put the stand-ins in place of the library, of the look and of the dashboard."""
        robot = self
        receive, control = ModuleType("rtde_receive"), ModuleType("rtde_control")
        receive.RTDEReceiveInterface = lambda *arguments: FakeReceive(robot, arguments)
        control.RTDEControlInterface = type(
            "RTDEControlInterface",
            (FakeControl,),
            {"FLAG_UPLOAD_SCRIPT": 1, "FLAG_UPPER_RANGE_REGISTERS": 8, "robot": robot},
        )
        monkeypatch.setitem(sys.modules, "rtde_receive", receive)
        monkeypatch.setitem(sys.modules, "rtde_control", control)
        monkeypatch.setattr("orientd_ur.driver.require_library", lambda: None)
        probe = Probe(version, True, 7, 1, 1, True, 0.0005, 0.0005)
        monkeypatch.setattr("orientd_ur.driver.look", lambda *_, **__: probe)
        arm = MODELS["ur5e"].arm()
        monkeypatch.setattr("orientd_ur.robot.ask", lambda *_: arm)
        monkeypatch.setattr("orientd_ur.link.RtdeClient", lambda *_, **__: FakeRegisters(robot))
        monkeypatch.setattr("orientd_ur.program.Dashboard", lambda _: FakeDashboard(robot))
        return self

    def driver(self, **options):
        settings = {"host": HOST, "keep_phase": False, "unlock_timeout": 0.2, **options}
        driver = UrDriver(settings, period_ns=2_000_000, clock=ManualClock(10**12))
        driver.open()
        return driver


READINGS = {
    "isConnected": lambda robot: robot.is_connected,
    "getTimestamp": lambda robot: robot.tick(),
    "getRobotMode": lambda robot: robot.mode(),
    "getSafetyMode": lambda robot: robot.modes[1],
    "getRuntimeState": lambda robot: robot.modes[2],
    "getActualTCPPose": lambda robot: robot.pose,
    "getTargetTCPPose": lambda robot: robot.target_pose,
    "getActualTCPSpeed": lambda robot: robot.speed,
    "getActualQ": lambda robot: robot.joints,
    "getTargetQ": lambda robot: robot.target_joints,
    "getSpeedScaling": lambda robot: robot.scaling,
    "getTargetSpeedFraction": lambda robot: robot.fraction,
    "isProgramRunning": lambda robot: robot.is_playing(),
}
"""What the library says of the robot, by its names of it."""


class FakeReceive:
    def __init__(self, robot, arguments):
        self.robot = robot
        robot.calls.append(("receive", arguments))

    def __getattr__(self, name):
        return lambda: READINGS[name](self.robot)

    def disconnect(self):
        self.robot.calls.append(("receive.disconnect", ()))


class FakeControl:
    def __init__(self, *arguments):
        self.robot.calls.append(("control", arguments))
        if self.robot.refusals:
            raise RuntimeError(self.robot.refusals.pop(0))
        self.robot.modes[2] = int(RuntimeState.PLAYING)

    def __getattr__(self, name):
        robot = self.robot
        if name == "isConnected":
            return lambda: robot.is_control_connected
        if name in READINGS:
            return lambda: READINGS[name](robot)

        def call(*arguments):
            robot.calls.append((name, arguments))
            # Every order but a setpoint leaves the command register clear; an upload leaves it.
            if name != "reuploadScript":
                robot.command = {"servoL": 24, "servoJ": 11}.get(name, 0)
            answer = robot.answers.get(name, True)
            if callable(answer):
                answer = answer()
            if isinstance(answer, Exception):
                raise answer
            return answer

        return call


class FakeRegisters:
    """What the controller says of its registers to another client."""

    def __init__(self, robot):
        self.robot = robot

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def subscribe(self, _frequency, names):
        self.names = names

    def sample(self):
        return dict.fromkeys(self.names, (self.robot.command,))


class FakeDashboard(SimpleNamespace):
    def __init__(self, robot):
        super().__init__(robot=robot)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    @property
    def is_remote(self):
        return self.robot.dashboard_answers.get("is in remote control", True)

    def ask(self, command):
        self.robot.dashboard.append(command)
        answer = self.robot.dashboard_answers.get(command, "Stopped")
        return answer() if callable(answer) else answer
