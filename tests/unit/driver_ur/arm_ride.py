"""The real servo in the middle of a planned motion of an arm, in virtual time."""

import numpy as np
from arm_rig import joints_of
from rig import PERIOD, PERIOD_NS, RecordingLoopback
from rig import Rig as LoopRig

from orientd import rotation
from orientd.clock import ManualClock
from orientd.daemon.device import servo_process
from orientd.servo import Servo, WatchdogTimeouts
from orientd.servo.path.path_follower import PathPart
from orientd.stream import Answer, Command, ServoState, SharedMemory


def servo_limits_of(motion):
    """Return what the daemon tells the servo of a motion."""
    facts = motion.facts
    return servo_process.servo_limits_of(facts.limits, facts.brake_rate)


class ArmRide(LoopRig):
    """A servo with a whole motion in its path ring, which can be anywhere on it at full speed.

    Args:
        motion: as planned.
        arm: whose joints follow it.
    """

    def __init__(self, motion, arm):
        self.motion, self.arm = motion, arm
        self.clock = ManualClock(10**9)
        self.memory = SharedMemory.create(1 << 15, 4096)
        self.driver = RecordingLoopback({}, period_ns=PERIOD_NS, clock=self.clock)
        self.driver.mechanism = lambda *, may_ask: arm
        self.driver.open()
        self.parent_is_alive, self.beats, self.noted = True, True, 0
        self.servo = Servo(
            self.driver,
            self.memory,
            period_ns=PERIOD_NS,
            watch=WatchdogTimeouts(10**9, 10**9, 10**9),
            clock=self.clock,
            parent_is_alive=lambda: self.parent_is_alive,
        )
        self.joints = motion.path.joints
        self.records = r = motion.records(0, motion.record_count)
        self.servo_limits = servo_limits_of(motion)
        self.run()
        assert self.ask(Command.ENABLE)[0] is Answer.DONE
        self.first = self.lay(
            r[:, :4], r[:, 4:7], r[:, 7:10], position=r[:, 10:13], velocity=r[:, 13:16],
            joints=r[:, 16:],
        )  # fmt: skip

    def go_to(self, record):
        """Be at a record at full speed, all before it having been sent."""
        servo, setpoints, here = self.servo, self.servo.setpoints, self.first + record
        self.parent_is_alive, servo.ending = True, ""
        setpoints.state = ServoState.HOLDING
        setpoints.last = setpoints.follower.peek(self.first)
        last = setpoints.last
        setpoints._guard.anchor(last.q, last.position, last.joints)
        self.command(Command.START, path_index=self.first, start_ns=10**18)
        setpoints.follower.begin(PathPart(1, here, self.servo_limits))
        setpoints.time_scaling.begin(self.servo_limits.brake_rate, 1.0)
        setpoints._is_waiting = False
        rows = self.records[record - 2 : record + 1]
        q, position = rows[:, :4], rows[:, 10:13]
        omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
        guard = setpoints._guard
        guard.q, guard.position = tuple(q[2].tolist()), tuple(position[2].tolist())
        guard.omega = tuple(omega[1].tolist())
        guard.alpha = tuple(((omega[1] - omega[0]) / PERIOD).tolist())
        guard.velocity = tuple(((position[2] - position[1]) / PERIOD).tolist())
        joints = self.joints[record - 2 : record + 1]
        rates = np.diff(joints, axis=0) / PERIOD
        guard.joints, guard.joint_rates = tuple(joints[2].tolist()), tuple(rates[1].tolist())
        guard.joint_changes = tuple(((rates[1] - rates[0]) / PERIOD).tolist())
        self.driver.setpoints.clear()
        self.record = record

    def command(self, command, **options):
        """Send a command and let a cycle pass."""
        answer, text = self.ask(command, **{"servo_limits": self.servo_limits, **options})
        assert answer is Answer.DONE, text

    def set_speed(self, speed):
        """Have the motion run at another speed; return whether it has not ended before."""
        if self.servo.state is not ServoState.STREAMING:
            return False
        self.command(Command.SPEED, speed=speed)
        return True

    def come_to_rest(self):
        """Let cycles pass until nothing moves, and two more."""
        while self.servo.is_moving and self.servo.setpoints.time_scaling.rate > 0.0:
            self.run()
        self.run(2)

    def excess(self):
        """Return the largest velocity and acceleration that the joints were sent, as shares."""
        before = [tuple(row) for row in self.joints[self.record - 1 : self.record + 1].tolist()]
        poses = [(s.q, s.position) for s in self.driver.setpoints]
        sent = np.vstack([before, joints_of(self.arm, poses, before[-1])])
        axes = self.arm.axes
        speed = np.abs(np.diff(sent, axis=0)) / PERIOD
        force = np.abs(np.diff(sent, 2, axis=0)) / PERIOD**2
        return (
            float(np.max(speed / [axis.velocity for axis in axes])),
            float(np.max(force / [axis.acceleration for axis in axes])),
        )


STOP, PAUSE, HALF, RANDOM, KILLED = "stop", "pause", "half speed", "random speeds", "killed"


def disturbed(ride, record, what, random=None):
    """Return how far the joints go beyond their limits where *what* happens at *record*."""
    ride.go_to(record)
    if what == STOP:
        ride.command(Command.STOP)
    elif what == KILLED:
        ride.parent_is_alive = False
        ride.run_until(lambda servo: servo.ending)
    elif what == PAUSE:
        if ride.set_speed(0.0):
            ride.come_to_rest()
            ride.set_speed(1.0)
            ride.run(80)
    elif what == HALF:
        if ride.set_speed(0.5):
            ride.run(40)
            ride.set_speed(1.0)
            ride.run(60)
    else:
        while ride.set_speed(float(random.choice([0.0, 1.0, random.random()]))):
            ride.run(int(random.integers(1, 80)))
            if random.random() < 0.3:
                ride.command(Command.STOP)
                break
    ride.come_to_rest()
    assert ride.servo.state is not ServoState.FAULT, ride.servo.setpoints.fault_text
    return ride.excess()
