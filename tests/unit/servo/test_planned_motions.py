"""The real servo on planned motions, in virtual time, with stops, pauses and speeds at random."""

import numpy as np
import pytest
from rig import PERIOD, Rig

from orientd import rotation
from orientd.daemon.device import queue
from orientd.planner import DEFAULT_LIMITS, Keyframe, Limits, MotionRequest, plan
from orientd.planner import State as PlannedState
from orientd.stream.records import Answer, Command, ServoState

TIGHT = Limits(
    velocity=1.0, acceleration=3.0, jerk=40.0, linear_velocity=0.5, linear_acceleration=5.0
)


def random_request(random, *, is_timed):
    count = int(random.integers(2, 7))
    steps = random.normal(size=(count, 3)) * 0.25
    q = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in steps[1:]:
        q.append(rotation.multiply(q[-1], rotation.exp(step)))
    times = np.cumsum(random.uniform(0.8, 1.6, count))
    return MotionRequest(
        [
            Keyframe(tuple(key.tolist()), float(t) if is_timed else None)
            for key, t in zip(q, times, strict=True)
        ],
        start_velocity=tuple(random.normal(size=3) * 0.2),
        end_velocity=tuple(random.normal(size=3) * 0.2),
        approach=True,
    )


def plan_until_it_fits(random, start, limits, *, is_timed):
    from orientd.errors import PlanError

    for _ in range(50):
        try:
            request = random_request(random, is_timed=is_timed)
            return plan(request, start=start, limits=limits, period=PERIOD)
        except PlanError:
            continue
    raise AssertionError("no random motion fits")


def peaks(q):
    q = np.vstack([q[:1], q[:1], q[:1], q])
    omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    jerk = np.diff(alpha, axis=0) / PERIOD
    return [float(np.linalg.norm(part, axis=1).max()) for part in (omega, alpha, jerk)]


def lay(rig, motion):
    records = motion.records(0, motion.record_count)
    return rig.lay(records[:, :4], records[:, 4:7], records[:, 7:10], position=records[:, 10:13])


def servo_limits_of(motion):
    return queue.servo_limits_of(motion.limits, motion.certificate.brake_rate)


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, TIGHT], ids=["default", "tight"])
@pytest.mark.parametrize("is_timed", [True, False], ids=["timed", "fastest"])
@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_commanded_the_limits_are_kept_and_the_path_is_not_left(seed, is_timed, limits):
    random = np.random.default_rng([seed, is_timed])
    rig = Rig(capacity=16384)
    rig.ask(Command.ENABLE)
    for number in range(1, 4):
        cycle = rig.run()
        start = PlannedState.at_rest(cycle.q, cycle.position)
        motion = plan_until_it_fits(random, start, limits, is_timed=is_timed)
        first = lay(rig, motion)
        answer, text = rig.ask(
            Command.START, motion=number, path_index=first, servo_limits=servo_limits_of(motion)
        )
        assert answer is Answer.DONE, text
        while rig.servo.state is ServoState.STREAMING:
            rig.run(int(random.integers(1, 400)))
            if rig.servo.state is not ServoState.STREAMING:
                break
            if random.random() < 0.15:
                rig.ask(Command.STOP)
                took = rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
                assert took * PERIOD <= 2.0 / motion.certificate.brake_rate + 3 * PERIOD
            else:
                speed = float(random.choice([0.0, 1.0, 1.0, random.random()]))
                rig.ask(Command.SPEED, speed=speed)
                if speed == 0.0:
                    rig.run(int(random.integers(1, 600)))
                    rig.ask(Command.SPEED, speed=1.0)
        assert rig.servo.state is ServoState.HOLDING, rig.cycle
    sent = rig.sent()
    velocity, acceleration, jerk = peaks(sent)
    assert velocity <= limits.velocity * 1.001
    assert acceleration <= limits.acceleration * 1.001
    assert jerk <= limits.jerk * 1.001


@pytest.mark.parametrize("seed", range(4))
def test_every_setpoint_lies_on_the_planned_path_at_its_path_time(seed):
    random = np.random.default_rng(100 + seed)
    rig = Rig(capacity=16384)
    rig.ask(Command.ENABLE)
    cycle = rig.run()
    start = PlannedState.at_rest(cycle.q, cycle.position)
    motion = plan_until_it_fits(random, start, DEFAULT_LIMITS, is_timed=True)
    first = lay(rig, motion)
    rig.ask(Command.START, path_index=first, servo_limits=servo_limits_of(motion))
    path_times, q = [], []
    while rig.servo.state is ServoState.STREAMING:
        if random.random() < 0.01:
            rig.ask(Command.SPEED, speed=float(random.uniform(0.05, 1.0)))
        cycle = rig.run()
        path_times.append((cycle.path_index - first + cycle.path_fraction) * PERIOD)
        q.append(cycle.q)
    # Between records the servo draws a cubic.
    assert rotation.angle(motion.sample(path_times).q, np.array(q)).max() < 5e-7
