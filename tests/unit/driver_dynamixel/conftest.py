"""A driver on an emulated bus with virtual time."""

import random

import numpy as np
import pytest
from rig import PERIOD, PERIOD_NS
from rig import Rig as LoopRig

from emulated_dynamixel import MODELS, Bus, EmulatedServo, ManualClock, SerialLine, VirtualPort
from orientd.driver import Setpoint
from orientd.planner.recorded import joint_rates
from orientd.servo.servo import Servo as ServoLoop
from orientd.servo.watchdog import WatchdogTimeouts
from orientd.stream.memory import SharedMemory
from orientd.stream.records import JOINTS

MS = 1_000_000


# Axes set off at once in most tests, which turn them by steps.
ABRUPT = {"acceleration_deg": 1e5}


def axes_for(order, *, models=None, **common):
    models = models or ["xm430"] * len(order)
    return [
        {"id": number + 1, "name": name, "model": model, "limits_deg": [-270, 270], **common}
        for number, (name, model) in enumerate(zip(("yaw", "pitch", "roll"), models, strict=False))
    ][: len(order)]


class Rig:
    """An emulated bus, a driver on it, and the loop that a servo process would be."""

    def __init__(self, order="ZYX", *, rate_hz=200, models=None, latency_ms=4.0, seed=0,
                 is_paced=True, usb_ms=1, axes=None, **options):  # fmt: skip
        pytest.importorskip("dynamixel_sdk")
        from dynamixel_sdk import Protocol2PacketHandler

        from orientd_dynamixel import DynamixelDriver
        from orientd_dynamixel.bus import ServoBus

        self.period_ns = 1_000_000_000 // rate_hz
        self.clock = ManualClock(1_000_000_000)
        models = models or ["xm430"] * len(order)
        self.bus = Bus(
            [
                EmulatedServo(k + 1, MODELS[m], now_ns=self.clock.now_ns())
                for k, m in enumerate(models)
            ],
            line=SerialLine(is_paced=is_paced, usb_latency_ns=usb_ms * MS if is_paced else 0),
            rng=random.Random(seed),
        )
        self.port = VirtualPort(self.bus, self.clock)

        def open_bus(port, baud, *, wait_ms, glance_s):
            self.port.openPort()
            self.port.ser.timeout = glance_s
            return ServoBus(self.port, Protocol2PacketHandler(), wait_ms=wait_ms)

        self.driver = DynamixelDriver(
            {"port": "virtual", "order": order, "latency_ms": latency_ms,
             "turns_file": "", "overwrite": ["operating_mode"],
             "axes": [{**ABRUPT, **axis} for axis in axes or axes_for(order, models=models)],
             **options},
            period_ns=self.period_ns, clock=self.clock, open_bus=open_bus,
            sleep=lambda seconds: self.clock.advance(round(seconds * 1e9)),
        )  # fmt: skip
        self.next_ns = self.clock.now_ns()
        self.q = self.joints = None
        self.seen = []

    def servo(self, number):
        return self.bus.servo(number)

    def value(self, number, name):
        servo = self.servo(number)
        servo.read(0, 100, self.clock.now_ns())
        return servo.value(name)

    def start(self):
        self.driver.open()
        feedback = self.enable()
        self.next_ns = self.clock.now_ns()
        return feedback

    def enable(self):
        feedback = self.driver.enable()
        self.q, self.joints = feedback.q, feedback.joints
        return feedback

    def cycle(self, angles=None, q=None, *, write=True):
        """Wait for the next deadline, read, write."""
        self.next_ns += self.period_ns
        while self.next_ns < self.clock.now_ns():
            self.next_ns += self.period_ns
        self.clock.advance(self.next_ns - self.clock.now_ns())
        feedback = self.driver.read()
        self.seen.append(feedback)
        if angles is not None:
            self.q, self.joints = self.driver._gimbal.orientation(angles), tuple(angles)
        if q is not None:
            self.q, self.joints = q, self.driver._gimbal.solve(q, self.joints)[0]
        if write:
            self.driver.write(Setpoint(self.next_ns, self.q, joints=self.joints))
        return feedback

    def run(self, count, path=None, *, write=True):
        """Do *count* cycles, along ``path(number)`` if there is one."""
        for number in range(count):
            self.cycle(None if path is None else path(number), write=write)

    def goals(self):
        return [self.servo(k + 1).value("goal position") for k in range(len(self.bus.servos))]


class GimbalLoop(LoopRig):
    """The servo loop on an emulated gimbal instead of a loopback."""

    def __post_init__(self):
        self.gimbal = self.options["gimbal"]
        self.clock = self.gimbal.clock
        self.driver = self.gimbal.driver
        self.memory = SharedMemory.create(self.capacity, 4096)
        self.driver.open()
        self.parent_is_alive = self.beats = True
        self.servo = ServoLoop(
            self.driver, self.memory, period_ns=PERIOD_NS,
            watch=WatchdogTimeouts(self.heartbeat_ns, self.feedback_ns), clock=self.clock,
            parent_is_alive=lambda: True,
        )  # fmt: skip
        self.memory.beat(self.clock.now_ns())

    def lay(self, q, *path, **options):
        """Put a path of orientations into the ring, with the angles of the axes that make them."""
        joints = [self.servo.setpoints.last.joints]
        for orientation in q:
            joints.append(self.driver._gimbal.solve(tuple(orientation), joints[-1])[0])
        angles = np.array(joints[1:])
        axes = angles.shape[1]
        table = np.full((len(q), 2 * JOINTS), np.nan)
        table[:, :axes] = angles
        table[:, JOINTS : JOINTS + axes] = joint_rates(angles, angles[[0, 0]], PERIOD)
        return super().lay(q, *path, joints=table, **options)


@pytest.fixture(autouse=True)
def _turns_of_its_own(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def rig():
    return Rig


@pytest.fixture
def gimbal():
    it = Rig()
    it.start()
    return it


@pytest.fixture
def gimbal_loop():
    return lambda gimbal: GimbalLoop(options={"gimbal": gimbal})
