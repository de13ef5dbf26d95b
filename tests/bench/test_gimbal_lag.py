"""How late a gimbal is that follows targets of 60 Hz, from end to end.

A real daemon, emulated servos in a process of their own, and between the two somebody who reads the
goals on the wire.  Targets turn at a constant rate about the axis of yaw; how late a goal is, is
the time at which it went over the wire less the time at which the target was there.  The servo's
own lag, from its goal to its position, comes on top, whoever commands it.
"""

import statistics
import time

import numpy as np
import pytest
from gimbal_bench import EmulatedGimbal, GimbalDaemon
from harness import until
from reference.wire import GOAL, PtyTee

import orientd
from orientd import rotation
from orientd.protocol import control_pb2 as pb

pytest.importorskip("dynamixel_sdk")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(300)]

PERIOD, RATE, SECONDS, TURN = 1 / 60, 0.5, 8.0, 4096
SETTLED = 0.5
ALLOWED_MS = 5.0


@pytest.fixture
def gimbal(request, tmp_path):
    bus = EmulatedGimbal(tmp_path / "bus")
    tee = PtyTee(tmp_path / "tapped", bus.link)
    daemon = GimbalDaemon(
        tmp_path, tee.link, ("rate_hz = 100 ", f"rate_hz = {request.param} ")
    ).start()
    with orientd.connect(daemon.socket) as robot:
        yield robot, tee
    daemon.end()
    tee.end()
    bus.end()


def turned(robot, says):
    """Turn at the rate from rest on; return when the target was at zero, s of the wire's reader."""
    extra = {"angular_velocity": [0.0, 0.0, RATE]} if says == "velocity" else {}
    with robot.track() as tracking:
        began = time.monotonic()
        for k in range(round(SECONDS / PERIOD)):
            due = began + k * PERIOD
            time.sleep(max(0.0, due - time.monotonic()))
            w, x, y, z = rotation.exp(np.array([0, 0, RATE * (time.monotonic() - began)])).tolist()
            tracking.aim(orientd.Quaternion(w=w, x=x, y=y, z=z), time_to_live=0.2, **extra)
    return began


@pytest.mark.parametrize("says", ["velocity", "nothing"])
@pytest.mark.parametrize("gimbal", [100, 200], indirect=True)
def test_goals_on_the_wire_are_5_ms_late_at_most(gimbal, says):
    robot, tee = gimbal
    until(lambda: robot.state().devices["gimbal"].state == pb.STATE_HOLDING, "a gimbal at rest")
    began = turned(robot, says)
    goals = [one for one in tee.reader.written if (one.servo, one.address) == (1, GOAL)]
    late = [
        one.at - began - (one.value - TURN / 2) * 2 * np.pi / TURN / RATE
        for one in goals
        if SETTLED < one.at - began < SECONDS - 0.1
    ]
    p50, p99 = statistics.median(late) * 1e3, float(np.percentile(late, 99)) * 1e3
    print(f"\ntargets of 60 Hz with {says}: goals {p50:.2f} ms late, p99 {p99:.2f}, of {len(late)}")
    assert p50 <= ALLOWED_MS
