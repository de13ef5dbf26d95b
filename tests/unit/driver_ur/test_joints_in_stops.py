"""Stops, pauses and other speeds of an arm keep every limit of its joints, wherever they begin."""

import os

import numpy as np
import pytest
from arm_ride import ArmRide
from joint_ride import HALF, KILLED, PAUSE, RANDOM, STOP, disturbed
from rig import PERIOD, PERIOD_NS

from emulated_dynamixel import ManualClock
from orientd import rotation
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.tolerances import GUARD_TOLERANCE
from orientd_ur import UrDriver
from orientd_ur.arm import MODELS

CASES = int(os.environ.get("ORIENTD_CASES", "6"))
SEED = int(os.environ.get("ORIENTD_SEED", "41"))
LIMITS = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)


def driver_of(model, **options):
    settings = {"host": "127.0.0.9", "model": model, **options}
    return UrDriver(settings, period_ns=PERIOD_NS, clock=ManualClock(1))


def random_motion(random):
    """Return a motion of a random arm past its straight wrist, or ``None`` if it is refused."""
    acceleration = float(random.choice([2291.8, random.uniform(150, 1200)]))
    driver = driver_of(str(random.choice(list(MODELS))), joint_acceleration_deg=acceleration)
    arm = driver.mechanism(may_ask=False)
    bend = random.choice([-1.0, 1.0]) * random.uniform(0.03, 0.5)
    joints = (
        random.uniform(-1, 1), -1.4 + random.uniform(-0.3, 0.3), 1.4 + random.uniform(-0.5, 0.5),
        random.uniform(-2.5, -0.5), bend, random.uniform(-3, 3),
    )  # fmt: skip
    q, position = arm.forward(joints)
    start = State.at_rest(q, position)
    count = int(random.integers(1, 4))
    is_timed = random.random() < 0.3
    seconds = np.cumsum([0.0, *random.uniform(0.7, 3.0, count)]) if is_timed else [None] * 9
    keyframes = [Keyframe(q, None if not is_timed else 0.0, position=position)]
    for time in seconds[1 : count + 1]:
        turn = rotation.exp(0.4 * random.normal(size=3))
        q = tuple(rotation.multiply(np.array(keyframes[-1].q), turn).tolist())
        there = position + 0.1 * random.normal(size=3) * (random.random() < 0.5)
        keyframes.append(Keyframe(q, time, position=tuple(there.tolist())))
    pace = None if is_timed else str(random.choice(["even", ""])) or None
    request = MotionRequest(keyframes, approach=True, pace=pace)
    limits = LIMITS.slowed(random.uniform(0.2, 1.0))
    planner = DevicePlanner(driver, limits=limits, period=PERIOD)
    try:
        motion = planner.plan(request, start=start, joints=joints, is_offline=True)
    except PlanError:
        return None
    return motion, arm


def random_rides(seed, count):
    random = np.random.default_rng(seed)
    while count:
        planned = random_motion(random)
        if planned is not None and 40 < planned[0].record_count < 5000:
            count -= 1
            yield ArmRide(*planned), random


def assert_keeps(ride, record, what, random):
    speed, force = disturbed(ride, record, what, random)
    assert speed <= GUARD_TOLERANCE, (record, what)
    assert force <= GUARD_TOLERANCE, (record, what)


def test_no_joint_of_random_arms_exceeds_its_limits():
    for ride, random in random_rides(SEED, CASES):
        # Half of them where a joint turns fastest, or its speed changes most.
        steps = np.abs(np.diff(ride.joints, axis=0)) / [axis.velocity for axis in ride.arm.axes]
        bends = np.abs(np.diff(steps, axis=0))
        for k in range(10):
            record = int(random.integers(3, len(ride.joints) - 20))
            if k % 2:
                near = int(np.argmax(np.max(steps if k % 4 == 1 else bends, axis=1)))
                record = min(max(near - int(random.integers(0, 50)), 3), len(ride.joints) - 20)
            assert_keeps(ride, record, (STOP, PAUSE, HALF, RANDOM, KILLED)[k % 5], random)


def test_stops_where_the_acceleration_of_a_joint_changes_fast_keep_its_limit():
    """Near a straight wrist it goes from one limit to the other within a few records."""
    random, rides = np.random.default_rng(6), 0
    for _ in range(10):
        model = str(random.choice(["ur3e", "ur5e", "ur10e", "ur30"]))
        driver = driver_of(model, joint_acceleration_deg=2291.8)
        arm = driver.mechanism(may_ask=False)
        bend = float(random.choice([-1, 1]) * random.uniform(0.03, 0.15))
        joints = (
            random.uniform(-1, 1), -1.4 + random.uniform(-0.3, 0.3),
            1.4 + random.uniform(-0.4, 0.4), random.uniform(-2.5, -0.5), bend,
            random.uniform(-2, 2),
        )  # fmt: skip
        q, position = arm.forward(joints)
        turn = random.normal(size=3)
        turn *= random.uniform(0.1, 0.6) / np.linalg.norm(turn)
        goal = tuple(rotation.multiply(np.array(q), rotation.exp(turn)).tolist())
        request = MotionRequest([Keyframe(goal, position=position)])
        planner = DevicePlanner(driver, limits=LIMITS, period=PERIOD)
        try:
            motion = planner.plan(
                request, start=State.at_rest(q, position), joints=joints, is_offline=True
            )
        except PlanError:
            continue
        rides += 1
        ride = ArmRide(motion, arm)
        for record in range(3, min(motion.record_count - 10, 160), 8):
            for what in (STOP, PAUSE):
                assert_keeps(ride, record, what, random)
    assert rides > 5


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("what", [STOP, PAUSE, HALF, RANDOM, KILLED])
def test_no_joint_exceeds_its_limits_whatever_happens_at_every_eighth_cycle(what):
    for ride, random in random_rides(SEED + 1, CASES):
        for record in range(3, len(ride.joints) - 1, 8):
            assert_keeps(ride, record, what, random)
