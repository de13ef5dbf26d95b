"""Stops of the real servo on planned motions, against the shortest that are possible."""

from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, Rig
from shortest_stop import bound

import orientd.planner.limits
from orientd import rotation
from orientd.errors import OrientdError
from orientd.planner import Keyframe, Limits, MotionRequest, plan
from orientd.planner import State as PlannedState
from orientd.planner.certificate import measure
from orientd.servo.path_follower import Leg
from orientd.stream import UNKNOWN, Answer, Command, State, Terms

LIMITS = [
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(1.0, 3.0, 40.0, 0.5, 5.0),
    Limits(0.3, 0.4, 5.0, 0.2, 0.5),
    Limits(10.0, 200.0, 3e4, 3.0, 30.0),
]
# Those that are planned quickly; smooth ones, and ones with steps of the acceleration or jerk.
SOME_METHODS = ["c2_cumulative", "kks_hermite_spline", "schlag_bspline", "squad"]
AS_IT_IS = orientd.planner.limits.ACCELERATION_RESERVE
COARSE = 2 * PERIOD
"""A stop begins and ends with a cycle: the time of one that falls between them."""


def random_motion(random, limits, reserve):
    """Return a motion of any method that keeps *reserve* of its limits, or ``None``."""
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
        method=str(random.choice(SOME_METHODS)),
        approach=True,
    )
    start = PlannedState.at_rest(tuple(q[0].tolist()), (0.0, 0.0, 0.0))
    orientd.planner.limits.ACCELERATION_RESERVE = reserve
    try:
        return plan(request, start=start, limits=limits, period=PERIOD)
    except OrientdError:
        return None
    finally:
        orientd.planner.limits.ACCELERATION_RESERVE = AS_IT_IS


def up_to_its_limits(random, motion):
    """Return a motion with limits lowered to what it reaches, as a user's own times may do."""
    certificate = motion.certificate
    peaks = {
        name: 1.0005 * getattr(certificate, f"peak_{name}").value
        for name in ("velocity", "acceleration", "jerk")
        if random.random() < 0.7
    }
    limits = replace(motion.limits, **peaks)

    def setpoints(first, count):
        samples = motion.path.sample(PERIOD * np.arange(first, first + count))
        return samples.q, samples.position

    found = measure(
        setpoints,
        motion.record_count,
        PERIOD,
        limits,
        before=None,
        holds_after=True,
        brake_limits=limits.scaled(1.001),
        rough=motion.rough,
    )
    # What takes longer to stop is refused.
    if found.brake_rate < 0.25:
        return None
    certificate = replace(certificate, brake_rate=found.brake_rate)
    return replace(motion, limits=limits, certificate=certificate)


def motions(seed, count, kind):
    """Yield random motions: with the planner's reserve, with hardly any, up to their limits."""
    random = np.random.default_rng([seed, ["reserve", "no reserve", "at limits"].index(kind)])
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
        motion = random_motion(random, limits, AS_IT_IS if kind == "reserve" else 0.999)
        if motion is not None and kind == "at limits":
            motion = up_to_its_limits(random, motion)
        if motion is not None and motion.record_count < 16_000:
            found += 1
            yield motion


def terms_of(motion):
    limits = motion.limits
    return Terms(
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.linear_velocity,
        limits.linear_acceleration,
        motion.certificate.brake_rate,
        limits.axis_velocity,
        limits.axis_acceleration,
        limits.axis_jerk,
    )


class Ride:
    """A motion that the servo is in the middle of."""

    def __init__(self, motion, record):
        self.motion = motion
        self.rig = rig = Rig(capacity=1 << 14)
        rows = motion.records(0, motion.record_count)
        q, position = rows[:, :4], rows[:, 10:13]
        assert rig.ask(Command.ENABLE)[0] is Answer.DONE
        self.first = first = rig.lay(
            q, rows[:, 4:7], rows[:, 7:10], position=position, velocity=rows[:, 13:16]
        )
        servo, here = rig.servo, first + record
        servo._held = servo._follower.peek(first)
        terms = terms_of(motion)
        assert rig.ask(Command.START, path_index=first, terms=terms, start_ns=10**18)[0] is (
            Answer.DONE
        )
        # Going there cycle by cycle would write exactly the records.
        servo._follower.begin(Leg(1, here, terms))
        servo._path_clock.begin(terms.brake_rate, 1.0)
        servo._is_waiting = False
        last = q[record - 2 : record + 1]
        omega = rotation.log(rotation.multiply(rotation.conjugate(last[:-1]), last[1:]))
        guard = servo._guard
        self.omega, self.alpha = omega[1] / PERIOD, (omega[1] - omega[0]) / PERIOD**2
        self.velocity = (position[record] - position[record - 1]) / PERIOD
        guard.q, guard.position = tuple(q[record].tolist()), tuple(position[record].tolist())
        guard.omega, guard.alpha = tuple(self.omega.tolist()), tuple(self.alpha.tolist())
        guard.velocity = tuple(self.velocity.tolist())
        self.before = last, position[record - 1 : record + 1]
        rig.driver.setpoints.clear()
        self.remaining = (motion.record_count - 1 - record) * PERIOD
        self.path_times = []

    def run(self):
        """Let a cycle pass and note where on its path the setpoint is to be."""
        cycle = self.rig.run()
        self.path_times.append((cycle.path_index - self.first + cycle.path_fraction) * PERIOD)

    @property
    def deviation(self):
        """Largest angle between a setpoint and the motion's own curve, rad."""
        sent = np.array([s.q for s in self.rig.driver.setpoints])
        planned = self.motion.sample(np.minimum(self.path_times, self.motion.duration)).q
        return float(rotation.angle(planned, sent).max())

    def stop(self):
        """Stop and return how long it took."""
        written = len(self.rig.driver.setpoints)
        self.rig.memory.commands.publish(
            Command.STOP, 1, 0, UNKNOWN, UNKNOWN, 0, 1.0, *terms_of(self.motion).floats()
        )
        self.run()
        while self.rig.servo.is_moving:
            self.run()
        q = np.array([s.q for s in self.rig.driver.setpoints[written:]])
        moves = np.flatnonzero(rotation.angle(q[:-1], q[1:]) > 1e-12)
        return (moves[-1] + 2 if len(moves) else 1) * PERIOD

    def excess(self):
        """Return the largest share of a limit that what was written has reached."""
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


def check_stops(seed, kind, count, stops):
    random = np.random.default_rng(seed)
    ratios = []
    for motion in motions(seed, count, kind):
        for _ in range(stops):
            record = int(random.integers(4, motion.record_count - 4))
            ride = Ride(motion, record)
            time = ride.stop()
            assert ride.rig.servo.state is State.HOLDING, ride.rig.servo._fault_text
            # A cubic cannot follow a step of the acceleration between two records.
            assert ride.deviation < (1e-6 if motion.rough is None else 1e-5)
            assert ride.excess() <= 1.001
            least = bound(ride.omega, ride.alpha, ride.velocity, motion.limits)
            ratios.append(max(time - COARSE, 0.0) / min(least, ride.remaining))
    return np.array(ratios)


KINDS = ["reserve", "no reserve", "at limits"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_stop_takes_hardly_longer_than_any_stop_could(kind):
    ratios = check_stops(0, kind, 6, 12)
    # Against a bound that knows nothing of the path, which a few stops cannot come near.
    assert np.median(ratios) < 1.03
    assert np.percentile(ratios, 95) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_every_one_of_many_stops_keeps_the_limits_and_the_path(kind, seed):
    ratios = check_stops(seed, kind, 40, 10)
    assert np.percentile(ratios, 95) < 1.2


def wander(ride, random, changes):
    """Pause, resume and change speed at random; return whether the motion still goes on."""
    for _ in range(changes):
        speed = float(random.choice([0.0, 0.0, 1.0, 1.0, random.random()]))
        ride.rig.memory.commands.publish(
            Command.SPEED, 1, 0, UNKNOWN, UNKNOWN, 0, speed, *terms_of(ride.motion).floats()
        )
        for _ in range(int(random.choice([1, 3, 10, 40, 150]))):
            ride.run()
            if not ride.rig.servo.is_moving:
                return False
    return True


def check_sequences(seed, kind, count, sequences):
    random = np.random.default_rng(seed)
    for motion in motions(seed, count, kind):
        for _ in range(sequences):
            ride = Ride(motion, int(random.integers(4, max(5, motion.record_count // 2))))
            if wander(ride, random, 8):
                ride.stop()
            assert ride.rig.servo.state is State.HOLDING, ride.rig.servo._fault_text
            assert ride.deviation < (1e-6 if motion.rough is None else 1e-5)
            assert ride.excess() <= 1.001


@pytest.mark.parametrize("kind", KINDS)
def test_pauses_resumptions_and_stops_in_any_order_keep_the_limits_and_the_path(kind):
    check_sequences(10, kind, 3, 5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("kind", KINDS)
def test_many_more_pauses_resumptions_and_stops_do(kind, seed):
    check_sequences(seed, kind, 40, 10)
