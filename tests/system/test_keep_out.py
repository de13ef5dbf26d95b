"""Keep-out cones of a configuration, from the client to the setpoints at the driver."""

import math
import subprocess
import sys

import numpy as np
import pytest
from harness import DaemonProcess

import orientd
from orientd.errors import PlanError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import rotate

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
