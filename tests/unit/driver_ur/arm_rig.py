"""The real servo in virtual time, with a loopback device that has an arm's joints."""

from dataclasses import replace

import numpy as np

from orientd.clock import ManualClock
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.servo import Servo
from orientd.servo.watchdog import WatchdogTimeouts
from orientd.stream.memory import SharedMemory
from orientd.stream.records import (
    NOT_GIVEN,
    Command,
    NoteKind,
    ServoLimits,
    ServoState,
    unpack_note,
)
from orientd_loopback import LoopbackDriver
from orientd_ur.arm import MODELS
from orientd_ur.pose import pose_of

PERIOD_NS = 2_000_000
PERIOD = PERIOD_NS * 1e-9
TOOL = (0.02, -0.01, 0.12, 0.1, -0.2, 0.3)


def joints_of(arm, poses, near):
    """Return the joints that make poses of the tool, continuously from *near*, rad."""
    found = []
    for q, position in poses:
        near = arm.nearest(q, position, near)
        assert near is not None, "the arm does not reach what was sent"
        found.append(near)
    return np.array(found)


class ArmLoopback(LoopbackDriver):
    """A loopback device that is where it was sent, and has the joints of an arm."""

    def begin(self, arm, joints):
        self.arm = arm
        self.joints = joints
        self.setpoints = []

    def enable(self):
        return super().enable()._replace(joints=self.joints)

    def read(self):
        found = super().read()
        return found and found._replace(joints=self.joints)

    def mechanism(self, *, may_ask):
        return self.arm

    def write(self, setpoint):
        super().write(setpoint)
        self.setpoints.append(setpoint)
        self.joints = self.arm.nearest(setpoint.q, setpoint.position, self.joints) or self.joints


class CarelessArm(ArmLoopback):
    """The same without a look at its joints."""

    def mechanism(self, *, may_ask):
        return None


class ArmRig:
    """A servo that follows targets with an arm, and what was sent."""

    def __init__(
        self,
        model,
        joints,
        *,
        foresees=True,
        velocity=1.5,
        acceleration=8.0,
        jerk=400.0,
        linear_velocity=0.5,
        linear_acceleration=2.0,
        cones=(),
    ):
        self.arm, self.start = replace(MODELS[model].arm(), tool=pose_of(TOOL)), joints
        self.q, self.position = self.arm.forward(joints)
        self.limits = ServoLimits(
            velocity, acceleration, jerk, linear_velocity, linear_acceleration, 4.0
        )
        self.clock = ManualClock(10**9)
        self.memory = SharedMemory.create(4096, 4096)
        options = {
            "orientation": dict(zip("wxyz", self.q, strict=True)),
            "position": list(self.position),
        }
        kind = ArmLoopback if foresees else CarelessArm
        self.driver = kind(options, period_ns=PERIOD_NS, clock=self.clock)
        self.driver.begin(self.arm, joints)
        self.setpoints = self.driver.setpoints
        self.driver.open()
        self.servo = Servo(
            self.driver,
            self.memory,
            period_ns=PERIOD_NS,
            watch=WatchdogTimeouts(5 * 10**8, 10**8, 5 * 10**8),
            clock=self.clock,
            parent_is_alive=lambda: True,
            cones=KeepOutCones(cones, PERIOD_NS * 1e-9) if cones else None,
        )
        self.hindrances = set()
        for command in (Command.ENABLE, Command.TRACK):
            self.memory.commands.publish(command, 1, 0, -1, -1, -1, 1.0, *self.limits.floats())
            self.run()
        assert self.servo.state is ServoState.TRACKING

    def run(self):
        """Let a cycle pass."""
        self.clock.advance(PERIOD_NS)
        self.memory.beat(self.clock.now_ns())
        self.servo.cycle(self.clock.now_ns(), 0)
        if self.servo.setpoints.pursuit.hindrance:
            self.hindrances.add(self.servo.setpoints.pursuit.hindrance)

    def notices(self):
        """Return what the servo has said of the device."""
        ring = self.memory.notes
        notes = [unpack_note(ring.read_bytes(k)) for k in range(ring.head)]
        return [note.text for note in notes if note.kind is NoteKind.NOTICE]

    def follow(self, at, seconds, *, hz=50, position=None):
        """Stream targets: orientations *at* a time, and positions."""
        begin, count = self.clock.now_ns(), 0
        while self.clock.now_ns() < begin + seconds * 1e9:
            now = self.clock.now_ns()
            t = (now - begin) * 1e-9
            if t >= count / hz:
                where = NOT_GIVEN if position is None else position(t)
                self.memory.targets.publish(now, now + 3 * 10**8, *at(t), *NOT_GIVEN, *where)
                count += 1
            self.run()

    def check(self):
        """Stop, and look at all that was sent; return the joints of it, rad."""
        self.memory.commands.publish(Command.STOP, 1, 0, -1, -1, -1, 1.0, *self.limits.floats())
        for _ in range(5000):
            self.run()
            if not self.servo.is_moving:
                break
        assert self.servo.state is ServoState.HOLDING, self.servo.setpoints.fault_text
        poses = [(s.q, s.position) for s in self.setpoints]
        joints = joints_of(self.arm, poses, self.start)
        rates = np.diff(joints, axis=0, prepend=joints[:1]) / PERIOD
        changes = np.diff(rates, axis=0, prepend=rates[:1] * 0.0) / PERIOD
        assert (np.abs(rates) / [axis.velocity for axis in self.arm.axes]).max() <= 1.0
        assert (np.abs(changes) / [axis.acceleration for axis in self.arm.axes]).max() <= 1.0
        low, high = np.array([(axis.low, axis.high) for axis in self.arm.axes]).T
        assert (low <= joints).all()
        assert (joints <= high).all()
        reserves = [self.arm.reserve(row) for row in joints.tolist()]
        for every in zip(*reserves, strict=True):
            nearest = min(one.value for one in every)
            assert nearest >= min(0.98 * every[0].least_followed, every[0].value)
        return joints
