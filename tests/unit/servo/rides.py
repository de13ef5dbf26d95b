"""Random planned motions, and the real servo in the middle of them, in virtual time."""

from dataclasses import replace

import numpy as np
from rig import PERIOD, Rig

from orientd import rotation
from orientd.daemon.device import queue
from orientd.errors import OrientdError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.measuring import measure
from orientd.planner.planning import plan
from orientd.planner.state import State as PlannedState
from orientd.servo.path.path_follower import PathPart
from orientd.stream.records import UNKNOWN, Answer, Command
from orientd.tolerances import GUARD_TOLERANCE

LIMITS = [
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(1.0, 3.0, 40.0, 0.5, 5.0),
    Limits(0.3, 0.4, 5.0, 0.2, 0.5),
    Limits(10.0, 200.0, 3e4, 3.0, 30.0),
]
KINDS = ["reserve", "minimum", "at limits"]
"""The planner's reserve of acceleration, the small rest of the quickest timing, and limits lowered
to the rates of the motion."""
# Those that are planned quickly; smooth ones, and ones with steps of the acceleration or jerk.
SOME_METHODS = ["c2_cumulative", "kks_hermite_spline", "schlag_bspline", "squad"]


def random_motion(random, limits, methods, pace="even"):
    """Return a motion of one of *methods*, or ``None`` if the planner refuses it."""
    vectors = random.normal(size=(int(random.integers(2, 6)), 3)) * random.uniform(0.05, 1.5)
    q = [random.normal(size=4)]
    q[0] /= np.linalg.norm(q[0])
    for vector in vectors[1:]:
        q.append(rotation.multiply(q[-1], rotation.exp(vector)))
    is_moving_body = random.random() < 0.3
    positions = random.uniform(-0.3, 0.3, (len(q), 3)) if is_moving_body else [None] * len(q)
    request = MotionRequest(
        [
            Keyframe(tuple(key.tolist()), position=None if p is None else tuple(p.tolist()))
            for key, p in zip(q, positions, strict=True)
        ],
        method=str(random.choice(methods)),
        approach=True,
        pace=pace,
    )
    start = PlannedState.at_rest(tuple(q[0].tolist()), (0.0, 0.0, 0.0))
    try:
        return plan(request, start=start, limits=limits, period=PERIOD)
    except OrientdError:
        return None


def up_to_its_limits(random, motion):
    """Return a motion with limits lowered to its own rates, as with a user's own times."""
    certificate = motion.certificate
    peaks = {
        name: 1.0005 * getattr(certificate, f"peak_{name}").value
        for name in ("velocity", "acceleration", "jerk")
        if random.random() < 0.7
    }
    limits = replace(motion.limits, **peaks)

    found = measure(
        motion.path, motion.record_count, PERIOD, limits, before=None, tolerance=GUARD_TOLERANCE
    )
    # What takes longer to stop is refused.
    if found.brake_rate < 0.25:
        return None
    certificate = replace(certificate, brake_rate=found.brake_rate)
    return replace(motion, limits=limits, certificate=certificate)


def motions(seed, count, kind, methods=SOME_METHODS):
    """Yield *count* random motions of one of :data:`KINDS`; *seed* may be a sequence."""
    random = np.random.default_rng(seed)
    found = 0
    while found < count:
        limits = LIMITS[found % len(LIMITS)]
        if random.random() < 0.3:
            share = random.uniform(0.4, 0.9, 3)
            limits = replace(
                limits,
                axis_velocity=tuple(share * limits.velocity),
                axis_acceleration=tuple(share * limits.acceleration),
                axis_jerk=tuple(share * limits.jerk),
            )
        motion = random_motion(random, limits, methods, None if kind == "minimum" else "even")
        if motion is not None and kind == "minimum" and motion.certificate.notes:
            # No quickest timing was found: it has the reserve of an even one.
            continue
        if motion is not None and kind == "at limits":
            motion = up_to_its_limits(random, motion)
        if motion is not None and motion.record_count < 16_000:
            found += 1
            yield motion


def servo_limits_of(motion):
    return queue.servo_limits_of(motion.limits, motion.certificate.brake_rate)


class Track:
    """A servo with a whole motion in its path ring."""

    def __init__(self, motion):
        self.motion = motion
        self.rig = Rig(capacity=1 << 14)
        rows = motion.records(0, motion.record_count)
        self.q, self.position = rows[:, :4], rows[:, 10:13]
        assert self.rig.ask(Command.ENABLE)[0] is Answer.DONE
        self.first = self.rig.lay(
            self.q,
            rows[:, 4:7],
            rows[:, 7:10],
            position=self.position,
            velocity=rows[:, 13:16],
        )


class Ride:
    """A motion that the servo is in the middle of, having written its records up to one."""

    def __init__(self, track, record):
        self.motion = track.motion
        self.record = record
        self.rig = rig = track.rig
        q, position = track.q, track.position
        self.first = first = track.first
        setpoints, here = rig.servo.setpoints, first + record
        setpoints.last = setpoints.follower.peek(first)
        servo_limits = servo_limits_of(self.motion)
        assert rig.ask(Command.START, path_index=first, servo_limits=servo_limits, start_ns=10**18)[
            0
        ] is (Answer.DONE)
        # Going there cycle by cycle would write exactly the records.
        setpoints.follower.begin(PathPart(1, here, servo_limits))
        setpoints.time_scaling.begin(servo_limits.brake_rate, 1.0)
        setpoints._is_waiting = False
        last = q[record - 2 : record + 1]
        omega = rotation.log(rotation.multiply(rotation.conjugate(last[:-1]), last[1:]))
        guard = setpoints._guard
        self.omega, self.alpha = omega[1] / PERIOD, (omega[1] - omega[0]) / PERIOD**2
        self.velocity = (position[record] - position[record - 1]) / PERIOD
        guard.q, guard.position = tuple(q[record].tolist()), tuple(position[record].tolist())
        guard.omega, guard.alpha = tuple(self.omega.tolist()), tuple(self.alpha.tolist())
        guard.velocity = tuple(self.velocity.tolist())
        self.before = last, position[record - 1 : record + 1]
        rig.driver.setpoints.clear()
        self.remaining = (self.motion.record_count - 1 - record) * PERIOD
        self.path_times = []

    def run(self):
        """Run a cycle and note the place of the setpoint on the path."""
        cycle = self.rig.run()
        self.path_times.append((cycle.path_index - self.first + cycle.path_fraction) * PERIOD)

    @property
    def deviation(self):
        """Largest angle between a setpoint and the motion's own curve, rad."""
        sent = np.array([s.q for s in self.rig.driver.setpoints])
        planned = self.motion.sample(np.minimum(self.path_times, self.motion.duration)).q
        return float(rotation.angle(planned, sent).max())

    def stop(self):
        """Stop and return the number of cycles in which anything moved."""
        written = len(self.rig.driver.setpoints)
        self.command_stop()
        self.come_to_rest()
        q = np.array([s.q for s in self.rig.driver.setpoints[written:]])
        moves = np.flatnonzero(rotation.angle(q[:-1], q[1:]) > 1e-12)
        return int(moves[-1]) + 1 if len(moves) else 0

    def command_stop(self):
        self._command(Command.STOP, 1.0)

    def command_speed(self, speed):
        self._command(Command.SPEED, speed)

    def _command(self, command, speed):
        servo_limits = servo_limits_of(self.motion).floats()
        self.rig.memory.commands.publish(command, 1, 0, UNKNOWN, UNKNOWN, 0, speed, *servo_limits)

    def come_to_rest(self):
        self.run()
        while self.rig.servo.is_moving:
            self.run()

    @property
    def rates(self):
        """Path records that were passed in each cycle."""
        return np.diff([self.record, *(np.array(self.path_times) / PERIOD)])

    def excess(self):
        """Return the largest share of a limit that the setpoints have reached."""
        limits = self.motion.limits
        setpoints = self.rig.driver.setpoints
        q = np.vstack([self.before[0], [s.q for s in setpoints]])
        p = np.vstack([self.before[1], [s.position for s in setpoints]])
        omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
        alpha = np.diff(omega, axis=0) / PERIOD
        jerk = np.diff(alpha, axis=0) / PERIOD
        velocity = np.diff(p, axis=0) / PERIOD
        push = np.diff(velocity, axis=0) / PERIOD
        shares = [
            np.linalg.norm(omega, axis=1).max() / limits.velocity,
            np.linalg.norm(alpha, axis=1).max() / limits.acceleration,
            np.linalg.norm(jerk, axis=1).max() / limits.jerk,
            np.linalg.norm(velocity, axis=1).max() / limits.linear_velocity,
            np.linalg.norm(push, axis=1).max() / limits.linear_acceleration,
            np.max(np.abs(omega) / limits.axis_velocity),
            np.max(np.abs(alpha) / limits.axis_acceleration),
            np.max(np.abs(jerk) / limits.axis_jerk),
        ]
        return float(max(shares))
