"""The real servo in the middle of a planned motion of joints, in virtual time."""

import numpy as np
from rides import servo_limits_of
from rig import Rig

from emulated_dynamixel import ManualClock
from orientd import rotation
from orientd.servo.path.path_follower import PathPart
from orientd.servo.servo import Servo
from orientd.servo.watchdog import WatchdogTimeouts
from orientd.stream.memory import SharedMemory
from orientd.stream.records import Answer, Command, ServoState


class JointRide(Rig):
    """A servo with a whole motion in its path ring, which can be anywhere on it at full speed.

    Args:
        motion: as planned.
        make_driver: makes the driver, of a period in ns and a clock.
        servo_limits: of the motion, by default those that the daemon sends with it.
    """

    def __init__(self, motion, make_driver, servo_limits=None):
        self.motion, self.period = motion, motion.period
        self.parent_is_alive, self.beats, self.noted = True, True, 0
        self.period_ns = round(motion.period * 1e9)
        self.clock = ManualClock(10**9)
        self.memory = SharedMemory.create(1 << 15, 4096)
        self.driver = make_driver(period_ns=self.period_ns, clock=self.clock)
        self.driver.open()
        self.servo = Servo(
            self.driver,
            self.memory,
            period_ns=self.period_ns,
            watch=WatchdogTimeouts(10**9, 10**9, 10**9),
            clock=self.clock,
            parent_is_alive=lambda: self.parent_is_alive,
        )
        self.joints = motion.path.joints
        self.records = r = motion.records(0, motion.record_count)
        self.servo_limits = servo_limits or servo_limits_of(motion)
        self.run()
        assert self.ask(Command.ENABLE)[0] is Answer.DONE
        self.first = self.lay(
            r[:, :4], r[:, 4:7], r[:, 7:10], position=r[:, 10:13], velocity=r[:, 13:16],
            joints=r[:, 16:],
        )  # fmt: skip

    def run(self, cycles=1):
        """Let *cycles* pass."""
        for _ in range(cycles):
            self.clock.advance(self.period_ns)
            self.memory.beat(self.clock.now_ns())
            self.servo.cycle(self.clock.now_ns(), 0)

    def go_to(self, record):
        """Be at a record at full speed, all before it having been sent."""
        self.parent_is_alive, self.servo.ending, self.record = True, "", record
        setpoints, here = self.servo.setpoints, self.first + record
        setpoints.state = ServoState.HOLDING
        setpoints.last = last = setpoints.follower.peek(self.first)
        guard = setpoints._guard
        guard.anchor(last.q, last.position, last.joints)
        self.command(Command.START, path_index=self.first, start_ns=10**18)
        setpoints.follower.begin(PathPart(1, here, self.servo_limits))
        setpoints.time_scaling.begin(self.servo_limits.brake_rate, 1.0)
        setpoints._is_waiting = False
        rows = self.records[record - 2 : record + 1]
        q, position, joints = rows[:, :4], rows[:, 10:13], self.joints[record - 2 : record + 1]
        omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / self.period
        velocity, rates = (np.diff(part, axis=0) / self.period for part in (position, joints))
        for name, value in {
            "q": q[2],
            "omega": omega[1],
            "alpha": (omega[1] - omega[0]) / self.period,
            "position": position[2],
            "velocity": velocity[1],
            "joints": joints[2],
            "joint_rates": rates[1],
            "joint_changes": (rates[1] - rates[0]) / self.period,
        }.items():
            setattr(guard, name, tuple(value.tolist()))
        self.forget_sent()

    def forget_sent(self):
        """Forget all setpoints that the driver got."""
        self.driver.setpoints.clear()

    def sent_joints(self, before):
        """Return the joints that were sent, from two rows *before*, shape ``(n, axes)``."""
        raise NotImplementedError

    def splice(self, motion, record):
        """Have another motion take over at a record."""
        ring, rows = self.memory.path, motion.records(0, motion.record_count)
        first = ring.head
        for index, row in enumerate(rows.tolist(), first):
            ring.put([ring.layout.pack(index, *row)], index)
        ring.advance(first + len(rows))
        self.command(
            Command.SPLICE, motion=2, path_index=first, leave=self.first + record,
            final=first + len(rows) - 1, servo_limits=servo_limits_of(motion),
        )  # fmt: skip

    def command(self, command, **options):
        """Send a command and let a cycle pass; return whether it was done."""
        answer, text = self.ask(command, **{"servo_limits": self.servo_limits, **options})
        assert answer is Answer.DONE, text
        return True

    def set_speed(self, speed):
        """Have the motion run at another speed; return whether it has not ended before."""
        if self.servo.state is not ServoState.STREAMING:
            return False
        return self.command(Command.SPEED, speed=speed)

    def come_to_rest(self):
        """Let cycles pass until nothing moves, and two more."""
        while self.servo.is_moving and self.servo.setpoints.time_scaling.rate > 0.0:
            self.run()
        self.run(2)

    def excess(self):
        """Return the largest velocity and acceleration that the axes were sent, as shares."""
        sent = self.sent_joints(self.joints[self.record - 1 : self.record + 1])
        speed = np.abs(np.diff(sent, axis=0)) / self.period
        force = np.abs(np.diff(sent, 2, axis=0)) / self.period**2
        return (
            float(np.max(speed / [axis.velocity for axis in self.axes])),
            float(np.max(force / [axis.acceleration for axis in self.axes])),
        )


STOP, PAUSE, HALF, RANDOM, KILLED = "stop", "pause", "half speed", "random speeds", "killed"


def disturbed(ride, record, what, random=None):
    """Return how far the axes go beyond their limits where *what* happens at *record*."""
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
            ride.run(int(random.integers(1, 60)))
            if random.random() < 0.25:
                ride.command(Command.STOP)
                break
    ride.come_to_rest()
    assert ride.servo.state is not ServoState.FAULT, ride.servo.setpoints.fault_text
    return ride.excess()
