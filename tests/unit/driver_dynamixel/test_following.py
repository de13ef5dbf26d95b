"""Targets are followed by axes that have limits, over the bus."""

import math

import numpy as np
import pytest

from orientd.rotation import angle, exp
from orientd.stream.records import NOT_GIVEN, Command, ServoLimits, ServoState

AXES = [
    {"id": k + 1, "name": name, "limits_deg": [-reach, reach], "velocity_deg": 220,
     "acceleration_deg": 2290}
    for k, (name, reach) in enumerate((("yaw", 270), ("pitch", 100), ("roll", 270)))
]  # fmt: skip


def test_a_stop_amid_following_ends_where_the_axes_are(rig, gimbal_loop):
    gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0, axes=AXES)
    loop = gimbal_loop(gimbal)
    assert loop.ask(Command.ENABLE)[0].name == "DONE"
    limits = ServoLimits(3.0, 20.0, 2000.0, 1.0, 10.0, 1.0)
    loop.ask(Command.TRACK, motion=1, servo_limits=limits)
    now = loop.clock.now_ns()
    target = exp([0.0, 0.0, 1.0]).tolist()
    loop.memory.targets.publish(now, now + 10**10, *target, *([0.0] * 3), *NOT_GIVEN)
    loop.run(400)
    assert loop.cycle.state is ServoState.TRACKING
    assert math.degrees(loop.cycle.sent_joints[0]) == pytest.approx(57.3, abs=0.1)
    loop.ask(Command.STOP)
    loop.run_until(lambda servo: servo.state is ServoState.HOLDING)
    loop.run(50)
    assert loop.cycle.fault == 0
    assert angle(np.array(loop.cycle.q), np.array(target)) < 1e-6
