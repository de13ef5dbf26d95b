"""A client whose monotonic clock is not the daemon's: its stamps count as on one machine."""

import math
import time

import numpy as np
import pytest
from fleet_cell import AHEAD, can_have_own_clocks
from harness import DaemonProcess, until
from scipy.spatial.transform import Rotation

import orientd
from orientd.protocol import control_pb2 as pb
from orientd.rotation import Quaternion
from orientd_loopback import read_recording
from orientd_serving.served import Served

AHEAD_S = 1000
NS = 1_000_000_000

pytestmark = pytest.mark.skipif(not can_have_own_clocks(), reason="no clocks of one's own here")


@pytest.fixture(scope="module")
def distant(tmp_path_factory):
    """Return a daemon whose monotonic clock is 1000 s ahead of ours."""
    daemon = DaemonProcess(tmp_path_factory.mktemp("distant"))
    daemon.prefix = (*AHEAD, str(AHEAD_S))
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        yield daemon


@pytest.fixture
def robot(distant):
    with orientd.connect(distant.socket) as robot:
        robot.move([about_z(0.0)], approach=True).wait(20.0)
        yield robot


def about_z(angle):
    return Quaternion(w=math.cos(angle / 2.0), x=0.0, y=0.0, z=math.sin(angle / 2.0))


def angle_at(daemon, time_s):
    """Return the angle about z that the driver was sent for a time of ours, rad."""
    sent = [one for one in read_recording(daemon.recording) if one.time_ns >= AHEAD_S * NS]
    nearest = min(sent, key=lambda one: abs(one.time_ns - (time_s + AHEAD_S) * NS))
    return 2.0 * math.atan2(nearest.q[3], nearest.q[0])


def test_the_offset_is_measured_within_its_bound(distant, robot):
    offset = robot.clock_offset
    assert 0 < offset.bound_ns < NS
    assert abs(offset.ns - AHEAD_S * NS) <= offset.bound_ns
    assert offset == robot.clock_offset


def test_the_offset_on_one_machine_is_exactly_0(daemon):
    with orientd.connect(daemon.socket) as robot:
        assert (robot.clock_offset.ns, robot.clock_offset.bound_ns) == (0, 0)


def test_a_chunk_is_played_at_its_times(distant, robot):
    times = time.monotonic() + 0.5 + np.arange(40) / 20.0
    with robot.play() as play:
        play.chunk(Rotation.from_rotvec(np.outer(0.1 * (times - times[0]), [0, 0, 1])), times=times)
    assert (play.timing().live, play.timing().stale) == (40, 0)
    bound = 1e-9 * robot.clock_offset.bound_ns
    at = times[0] + 1.5
    assert angle_at(distant, at) == pytest.approx(0.15, abs=0.1 * (bound + 0.01))


def test_targets_with_stamps_are_followed_as_of_their_stamps(distant, robot):
    begin_ns = time.monotonic_ns()
    with robot.track() as tracking:
        for k in range(40):
            stamp_ns = begin_ns + (k + 6) * NS // 40
            angle = 0.1e-9 * (stamp_ns - begin_ns)
            tracking.aim(about_z(angle), angular_velocity=[0.0, 0.0, 0.1], time_ns=stamp_ns)
            time.sleep(max(0.0, 1e-9 * (begin_ns + k * NS // 40 - time.monotonic_ns())))
        assert tracking.report.left_out + tracking.report.refused == 0
    bound = 1e-9 * robot.clock_offset.bound_ns
    at = angle_at(distant, 1e-9 * begin_ns + 0.9)
    assert at == pytest.approx(0.09, abs=0.1 * (bound + 0.02))


def test_a_device_points_from_a_base_with_stamps(distant, robot):
    with robot.track() as tracking:
        for k in range(40):
            tracking.base(about_z(0.01 * k), time_ns=time.monotonic_ns())
            tracking.point(20.0, 0.0, time_ns=time.monotonic_ns())
            time.sleep(0.025)
        until(lambda: tracking.report.targets > 10, "targets")
        assert tracking.report.left_out + tracking.report.refused + tracking.skipped == 0
        assert not tracking.base_report.is_stale
    assert abs(2.0 * math.atan2(tracking.report.q.z, tracking.report.q.w)) > 0.05


def test_an_adapter_follows_a_path_at_its_times(distant, robot):
    with Served(robot) as served:
        start = time.monotonic() + 0.5
        poses = [about_z(0.01 * k) for k in range(40)]
        served.track().chunk(poses, rate=20.0, start=start)
        play = served.track()
        until(lambda: play.timing().chunks, "the path")
        assert (play.timing().live, play.timing().stale) == (40, 0)
        assert play.wait(10.0)
    bound = 1e-9 * robot.clock_offset.bound_ns
    assert angle_at(distant, start + 1.0) == pytest.approx(0.2, abs=0.2 * (bound + 0.01))
