"""Pointing at moving targets and from a moving base, with a real daemon."""

import json
import subprocess
import time

import numpy as np
import pytest
from command_line import assert_refused, begin, inside, orientd
from harness import DEVICE, DaemonProcess, until

from orientd import Quaternion, connect, rotation
from orientd.errors import RequestError, StaleBaseError, StateError
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

MAST = """[devices.arm.frames.mast]
base = {rotation_vector = [0, 0, 1.5707963267948966]}
"""


@pytest.fixture(scope="module")
def process(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), options=MAST) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@pytest.fixture
def robot(process):
    with connect(process.socket) as robot:
        yield robot


def turned(*vector):
    w, x, y, z = rotation.exp(np.array(vector)).tolist()
    return Quaternion(w=w, x=x, y=y, z=z)


def at(robot):
    q = robot.state().devices[DEVICE].cycle.q
    return np.array([q.w, q.x, q.y, q.z])


def points_along(robot, line, q_world_base=(1.0, 0.0, 0.0, 0.0), most=1e-3):
    """Return whether the x axis of the tool is along a line in the world."""
    x = rotation.rotate(rotation.multiply(q_world_base, at(robot)), (1.0, 0.0, 0.0))
    return np.linalg.norm(x - np.array(line) / np.linalg.norm(line)) < most


def test_a_point_is_looked_at_also_in_a_frame_of_the_configuration(process, robot):
    with robot.track(device=DEVICE) as tracking:
        tracking.look_at([3.0, 4.0, 0.0])
        until(lambda: points_along(robot, (3.0, 4.0, 0.0)), "the device points there")
        tracking.look_at([5.0, 0.0, 0.0], frame="mast")
        until(lambda: points_along(robot, (0.0, 1.0, 0.0)), "the device points along the frame")
        with pytest.raises(RequestError, match="no frame 'must'; did you mean 'mast'"):
            tracking.look_at([5.0, 0.0, 0.0], frame="must")
    process.assert_limits_kept()


def test_the_line_of_sight_stays_in_the_world_until_the_base_is_stale(process, robot):
    base = (0.9689124217106447, 0.0, 0.24740395925452294, 0.0)
    with robot.track(device=DEVICE) as tracking:
        tracking.look_at([1.0, 0.0, 0.0])

        def is_there():
            tracking.base(Quaternion(w=base[0], x=0.0, y=base[2], z=0.0), time_to_live=5.0)
            time.sleep(0.01)
            return points_along(robot, (1.0, 0.0, 0.0), base)

        until(is_there, "the device points there from the turned base")
        assert not tracking.base_report.is_stale
        until(lambda: tracking.base_report.is_stale, "the base is stale")
        with pytest.raises(StaleBaseError):
            tracking.look_at([0.0, 1.0, 0.0])
    process.assert_limits_kept()


def test_a_plan_is_followed_in_the_world(process, robot):
    robot.move([turned(0, 0, 0)], device=DEVICE).wait(20.0)
    plan = robot.plan([turned(0, 0, 0), turned(0, 0.4, 0)], device=DEVICE, approach=True)
    end = (np.cos(0.4), 0.0, -np.sin(0.4))
    with robot.track(device=DEVICE) as tracking:
        with pytest.raises(StateError, match="expected samples of the base first"):
            tracking.follow(plan)
        tracking.base(turned(0.2, 0, 0), time_to_live=30.0)
        tracking.follow(plan)

        def is_there():
            tracking.base(turned(0.2, 0, 0), time_to_live=30.0)
            time.sleep(0.01)
            return points_along(robot, end, rotation.exp(np.array((0.2, 0.0, 0.0))))

        until(is_there, "the end of the plan")
    process.assert_limits_kept()


def emulated_base(*options):
    return orientd("sim", "base", *options)


def test_an_emulated_base_can_be_piped_into_track(process):
    printed = emulated_base("--kind", "vehicle", "--rate", 50, "--seconds", 1, "--seed", 2)
    samples = printed.stdout.splitlines()
    assert 45 <= len(samples) <= 50
    # Their time has passed, so that they count from now.
    fresh = [json.dumps({**json.loads(one), "time_ns": 0}) for one in samples]
    lines = "\n".join(['{"point": [5, 1, 0], "roll": 0}', *fresh])
    track = begin("track", "--socket", process.socket, "--json", stdin=subprocess.PIPE)
    answer, errors = track.communicate(lines, timeout=30.0)
    report = json.loads(answer)
    assert (track.returncode, report["refused"], errors) == (0, 0, "")
    assert report["targets"] > 0


def test_options_of_an_emulated_base():
    lost = emulated_base("--dropouts", 0.99, "--seconds", 0)
    assert (lost.returncode, lost.stdout) == (0, "")
    late = emulated_base("--kind", "rest", "--latency-ms", 5, "--rate", 200, "--seconds", 0.01)
    first = json.loads(late.stdout.splitlines()[0])
    assert abs(first["base"]["quaternion"]["w"]) > 0.9999
    assert_refused(inside("sim", "base", "--kind", "car"), "expected one of ship", status=2)
