"""Stops, pauses and other speeds of an arm keep the speed of its joints, wherever they begin."""

import os

import numpy as np
from rides import PERIOD, Ride, Track, servo_limits_of

from orientd import rotation
from orientd.errors import PlanError
from orientd.planner import Keyframe, Limits, MotionRequest, State, plan
from orientd.stream import UNKNOWN, Command, ServoState
from orientd.tolerances import GUARD_TOLERANCE
from orientd_ur.arm import MODELS
from orientd_ur.joint_path import examine, follow

CASES = int(os.environ.get("ORIENTD_CASES", "12"))
LIMITS = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)


def random_motion(random):
    """Return an arm, a motion past its straight wrist, and the joints on its records, or None."""
    arm = MODELS[str(random.choice(list(MODELS)))].arm()
    bend = random.choice([-1.0, 1.0]) * random.uniform(0.03, 0.5)
    start = (random.uniform(-1, 1), -1.4, 1.4, random.uniform(-2.5, -0.5), bend, 0.0)
    q, position = arm.forward(start)
    keyframes = [Keyframe(q, position=position)]
    for _ in range(int(random.integers(1, 4))):
        q = rotation.multiply(np.array(keyframes[-1].q), rotation.exp(0.4 * random.normal(size=3)))
        there = position + 0.1 * random.normal(size=3) * (random.random() < 0.5)
        keyframes.append(Keyframe(tuple(q.tolist()), position=tuple(there.tolist())))
    begin = State.at_rest(keyframes[0].q, position)
    pace = str(random.choice(["even", ""])) or None
    request = MotionRequest(keyframes, approach=True, pace=pace)
    limits = LIMITS.slowed(random.uniform(0.2, 1.0))
    try:
        motion = plan(request, start=begin, limits=limits, period=PERIOD)
        rows = motion.records(0, motion.record_count)
        step = round(0.008 / PERIOD)
        times = PERIOD * np.arange(0, motion.record_count, step)
        examine(arm, times.tolist(), poses_of(rows[::step]), start)
    except PlanError:
        return None
    joints = np.array(list(follow(arm, poses_of(rows), start)))
    return arm, motion, joints


def poses_of(rows):
    """Return orientations and positions of records as the driver takes them."""
    return [(tuple(row[:4]), tuple(row[10:13])) for row in rows.tolist()]


def test_no_joint_of_random_arms_exceeds_its_speed():
    random = np.random.default_rng(41)
    found = 0
    while found < CASES:
        made = random_motion(random)
        if made is None or made[1].record_count > 5000:
            continue
        found += 1
        arm, motion, joints = made
        track = Track(motion)
        quickest = int(
            np.argmax(
                np.max(
                    np.abs(np.diff(joints, axis=0)) / [axis.velocity for axis in arm.axes], axis=1
                )
            )
        )
        for k in range(4):
            record = int(random.integers(3, motion.record_count - 20))
            if k % 2:
                record = max(quickest - int(random.integers(0, 50)), 3)
                record = min(record, motion.record_count - 20)
            ride = Ride(track, record)
            if k < 2:
                ride.command_stop()
            else:
                for speed in (0.0, 1.0, random.random(), 1.0):
                    if ride.rig.servo.state is not ServoState.STREAMING:
                        break
                    ride.rig.memory.commands.publish(
                        Command.SPEED, 1, 0, UNKNOWN, UNKNOWN, 0, speed,
                        *servo_limits_of(motion).floats(),
                    )  # fmt: skip
                    for _ in range(int(random.integers(1, 200))):
                        ride.run()
            while ride.rig.servo.is_moving and ride.rig.servo.setpoints.time_scaling.rate > 0.0:
                ride.run()
            assert ride.rig.servo.state is not ServoState.FAULT
            sent = [(s.q, s.position) for s in ride.rig.driver.setpoints]
            there = [joints[record], *follow(arm, sent, joints[record])]
            speeds = np.abs(np.diff(np.array(there), axis=0)) / PERIOD
            assert np.max(speeds / [axis.velocity for axis in arm.axes]) <= GUARD_TOLERANCE, (
                record,
                k,
            )
            track.rig.servo.setpoints.state = ServoState.HOLDING
