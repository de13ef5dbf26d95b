"""The real servo on motions of minimum duration, in virtual time, stopped and slowed at random."""

import numpy as np
import pytest
from rig import PERIOD, Rig
from scipy.spatial.transform import Rotation

from orientd.daemon.device.queue import servo_limits_of
from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, plan
from orientd.planner import State as PlannedState
from orientd.stream.records import Answer, Command, ServoState

TIGHT = DEFAULT_LIMITS.with_rates({"velocity": 1.0, "acceleration": 3.0, "jerk": 40.0})
UNEVEN = DEFAULT_LIMITS.with_rates(
    {"velocity": [1.0, 2.0, 0.6], "acceleration": [3.0, 8.0, 2.0], "jerk": [60.0, 200.0, 90.0]}
)


def random_motion(random, start, limits):
    rotation = Rotation.from_quat(start.q[[1, 2, 3, 0]])
    keyframes = [Keyframe(tuple(start.q))]
    for _ in range(int(random.integers(1, 5))):
        rotation = rotation * Rotation.from_rotvec(random.normal(size=3) * 0.3)
        keyframes.append(Keyframe(tuple(rotation.as_quat()[[3, 0, 1, 2]])))
    request = MotionRequest(keyframes, end_velocity=(0.1, 0.2, -0.1), duration="minimum")
    return plan(request, start=start, limits=limits, period=PERIOD)


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, TIGHT, UNEVEN], ids=["arm", "tight", "uneven"])
@pytest.mark.parametrize("seed", range(2))
def test_whatever_is_commanded_the_limits_are_kept(seed, limits):
    random = np.random.default_rng(seed)
    rig = Rig(capacity=16384)
    rig.ask(Command.ENABLE)
    for number in range(1, 4):
        cycle = rig.run()
        motion = random_motion(random, PlannedState.at_rest(cycle.q, cycle.position), limits)
        records = motion.records(0, motion.record_count)
        first = rig.lay(
            records[:, :4], records[:, 4:7], records[:, 7:10], position=records[:, 10:13]
        )
        servo_limits = servo_limits_of(motion.limits, motion.certificate.brake_rate)
        answer, text = rig.ask(
            Command.START, motion=number, path_index=first, servo_limits=servo_limits
        )
        assert answer is Answer.DONE, text
        while rig.servo.state is ServoState.STREAMING:
            rig.run(int(random.integers(1, 400)))
            if rig.servo.state is not ServoState.STREAMING:
                break
            if random.random() < 0.3:
                rig.ask(Command.STOP)
                rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
            else:
                rig.ask(Command.SPEED, speed=float(random.choice([1.0, random.uniform(0.1, 1.0)])))
        assert rig.servo.state is ServoState.HOLDING, rig.cycle
    sent = np.array(rig.sent())
    rotation = Rotation.from_quat(np.concatenate([sent[:1]] * 3 + [sent])[:, [1, 2, 3, 0]])
    omega = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    jerk = np.diff(alpha, axis=0) / PERIOD
    for rate, name in ((omega, "velocity"), (alpha, "acceleration"), (jerk, "jerk")):
        assert np.linalg.norm(rate, axis=1).max() <= getattr(limits, name) * 1.001
        assert np.all(np.abs(rate).max(axis=0) <= np.array(limits.axes(name)) * 1.001)
