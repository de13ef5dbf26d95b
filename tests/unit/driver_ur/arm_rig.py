"""The real servo in virtual time, with a loopback device that has an arm's joints."""

from dataclasses import replace

import numpy as np
from rig import PERIOD, RecordingLoopback, Rig

from orientd.stream.records import NOT_GIVEN, Command, NoteKind, ServoLimits, ServoState
from orientd_ur.arm import MODELS
from orientd_ur.pose import pose_of

TOOL = (0.02, -0.01, 0.12, 0.1, -0.2, 0.3)
LIMITS = {
    "velocity": 1.5,
    "acceleration": 8.0,
    "jerk": 400.0,
    "linear_velocity": 0.5,
    "linear_acceleration": 2.0,
    "brake_rate": 4.0,
}


def joints_of(arm, poses, near):
    """Return the joints that make poses of the tool, continuously from *near*, rad."""
    found = []
    for q, position in poses:
        near = arm.nearest(q, position, near)
        assert near is not None, "the arm does not reach what was sent"
        found.append(near)
    return np.array(found)


class ArmLoopback(RecordingLoopback):
    """A loopback device that is where it was sent, and has the joints of an arm."""

    def enable(self):
        return super().enable()._replace(joints=self.joints)

    def read(self):
        found = super().read()
        return found and found._replace(joints=self.joints)

    def mechanism(self, *, may_ask):
        return self.arm

    def write(self, setpoint):
        super().write(setpoint)
        self.joints = self.arm.nearest(setpoint.q, setpoint.position, self.joints) or self.joints


class CarelessArm(ArmLoopback):
    """The same without a look at its joints."""

    def mechanism(self, *, may_ask):
        return None


class ArmRig(Rig):
    """A servo that follows targets with an arm, and what was sent."""

    def __init__(
        self, model, joints, *, has_axes=True, hardest=40.0, cones=(), tracks=True, **limits
    ):
        arm = MODELS[model].arm().slower(hardest)
        self.arm, self.start = replace(arm, tool=pose_of(TOOL)), joints
        self.q, self.position = self.arm.forward(joints)
        self.limits = ServoLimits(**{**LIMITS, **limits})
        self.hindrances = set()
        options = {
            "orientation": dict(zip("wxyz", self.q, strict=True)),
            "position": list(self.position),
        }
        super().__init__(options, kind=ArmLoopback if has_axes else CarelessArm, cones=cones)
        self.driver.arm, self.driver.joints = self.arm, joints
        self.setpoints = self.driver.setpoints
        self.ask(Command.ENABLE)
        if tracks:
            self.ask(Command.TRACK, servo_limits=self.limits)
        assert self.servo.state is (ServoState.TRACKING if tracks else ServoState.HOLDING)

    def run(self, cycles=1):
        """Let cycles pass."""
        for _ in range(cycles):
            super().run()
            if self.servo.setpoints.pursuit.hindrance:
                self.hindrances.add(self.servo.setpoints.pursuit.hindrance)
        return self.cycle

    def notices(self):
        """Return what the servo has said of the device."""
        return [note.text for note in self.notes(NoteKind.NOTICE)]

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
        self.ask(Command.STOP, servo_limits=self.limits)
        self.run_until(lambda servo: not servo.is_moving)
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
