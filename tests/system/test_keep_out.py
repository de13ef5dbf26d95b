"""Keep-out cones of a configuration, from the client to the setpoints at the driver."""

import math
import subprocess
import sys
import time

import numpy as np
import pytest
from gimbal_bench import GimbalDaemon, await_hold
from harness import DaemonProcess, until

import orientd
from orientd.errors import PlanError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import rotate

pytestmark = pytest.mark.world

CONES = """
[[devices.arm.keep_out]]
name = "laser"
azimuth_elevation = {azimuth = 40, elevation = 5}
half_angle_deg = 15
"""


def toward(azimuth, elevation):
    return {"azimuth_elevation": {"azimuth": azimuth, "elevation": elevation}}


def clearance(sent):
    a, e = math.radians(40.0), math.radians(5.0)
    direction = [math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)]
    cosine = rotate(sent, [1.0, 0.0, 0.0]) @ np.array(direction)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) - 15.0


def test_a_daemon_refuses_leads_around_and_lists_its_cones(tmp_path):
    with DaemonProcess(tmp_path / "daemon", options=CONES, lease=3.0) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket, holder="ana") as robot:
            with pytest.raises(PlanError, match=r"inside keep-out laser"):
                robot.move([toward(45.0, 0.0)])
            first = robot.move([toward(80.0, 0.0)])
            # Around again, blended into the first one, and back in place of it.
            second = robot.move([toward(0.0, -10.0)], queue=True, blend_tolerance=0.1)
            assert first.wait().outcome in (pb.OUTCOME_DONE, pb.OUTCOME_PASSED)
            third = robot.move([toward(80.0, 20.0)])
            assert second.wait().outcome in (pb.OUTCOME_DONE, pb.OUTCOME_REPLACED)
            assert third.wait().outcome == pb.OUTCOME_DONE
            (cone,) = third.plan.keep_out
        told = subprocess.run(
            [sys.executable, "-m", "orientd", "status", "--socket", str(daemon.socket)],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        sent = daemon.sent()
        daemon.assert_limits_kept()
    assert cone.name == "laser"
    assert "keep-out     laser: 15 deg around azimuth 40.0, elevation 5.0 deg" in told
    assert rotate(sent[-1], [1.0, 0.0, 0.0])[1] > 0.9
    assert clearance(sent).min() >= -0.01


def aim_until(tracking, target, condition, what):
    """Send a target at rest 25 times a second until a condition holds."""

    def look():
        tracking.aim(target, angular_velocity=(0.0, 0.0, 0.0), time_to_live=1.0)
        time.sleep(0.04)
        return condition()

    until(look, what)


def about_z(degrees):
    a = math.radians(0.5 * degrees)
    return orientd.Quaternion(w=math.cos(a), x=0.0, y=0.0, z=math.sin(a))


def test_a_tracked_target_inside_is_held_at_the_edge_and_reported(tmp_path):
    with DaemonProcess(tmp_path / "daemon", options=CONES) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            with robot.track() as tracking:
                aim_until(
                    tracking, about_z(45.0), lambda: tracking.report.held_at == "laser", "the edge"
                )
                until(lambda: clearance(daemon.sent())[-1] < 0.15, "the axis at the edge")
                told = subprocess.run(
                    [sys.executable, "-m", "orientd", "status", "--socket", str(daemon.socket)],
                    capture_output=True,
                    text=True,
                    check=True,
                ).stdout
                aim_until(
                    tracking,
                    about_z(80.0),
                    lambda: rotate(daemon.sent()[-1], [1.0, 0.0, 0.0])[1] > 0.98,
                    "the target behind the cone",
                )
                until(lambda: not tracking.report.held_at, "a report")
            with robot.play() as play:
                play.chunk([about_z(a) for a in np.linspace(80.0, 40.0, 30)], rate=30.0)
                until(lambda: play.report.held_at == "laser", "the edge from the other side")
        sent = daemon.sent()
        daemon.assert_limits_kept()
    assert "held at the edge of the keep-out cone 'laser'" in told
    assert clearance(sent).min() >= -0.01


def test_a_gimbal_that_follows_keeps_out_with_its_axes(bus, tmp_path):
    pytest.importorskip("dynamixel_sdk")
    daemon = GimbalDaemon(tmp_path, bus.link)
    with daemon.config.open("a") as config:
        config.write(
            '\n[[devices.gimbal.keep_out]]\nname = "laser"\ndirection = [0.7, 0.7, 0.1]\n'
            "half_angle_deg = 10\n"
        )
    daemon.start()
    try:
        await_hold(daemon, "gimbal")
        with orientd.connect(daemon.socket) as robot:

            def away():
                q = robot.state().devices["gimbal"].cycle.q
                pointing = rotate(np.array([q.w, q.x, q.y, q.z]), [1.0, 0.0, 0.0])
                cosine = pointing @ np.array([0.7, 0.7, 0.1]) / math.sqrt(0.99)
                return math.degrees(math.acos(cosine)) - 10.0

            with robot.track() as tracking:
                aim_until(
                    tracking, about_z(45.0), lambda: tracking.report.held_at == "laser", "the edge"
                )
                aim_until(tracking, about_z(45.0), lambda: away() < 0.3, "the axis at the edge")
                assert away() > -0.01
            until(lambda: robot.state().devices["gimbal"].state == pb.STATE_HOLDING, "rest")
            assert robot.state().devices["gimbal"].fault_text == ""
            assert away() > -0.01
    finally:
        daemon.end()
