"""Frames of a configuration and of a motion, from the client to the device and back."""

import json
import subprocess
import sys

import numpy as np
import pytest
from harness import DEVICE, DaemonProcess

import orientd
from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion, to_vector
from orientd.protocol.reports import samples

pytestmark = pytest.mark.world

CAMERA = """
[devices.arm.frames.camera]
tool = {euler = {axes = "y", degrees = [90]}, position = [0, 0, 0.1]}
"""
TABLE = {"base": {"euler": {"axes": "z", "degrees": [90]}, "position": [1, 0, 0]}}
TURNS = [
    {"rotation_vector": [0, 0, 0], "position": [0, 0, 0.1]},
    {"rotation_vector": [0, 0, 0.3], "position": [0, 0.02, 0.1]},
]


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), options=CAMERA, lease=3.0) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


def commanded(robot):
    """Return orientation and position that were sent last."""
    cycle = robot.state().devices[DEVICE].cycle
    return to_quaternion(cycle.q), to_vector(cycle.position)


def test_a_motion_in_a_configured_frame_is_reported_in_it_and_sent_as_the_flange(daemon):
    with orientd.connect(daemon.socket, holder="ana") as robot:
        robot.move([{**TURNS[0]}], frame="camera").wait()
        plan = robot.plan(TURNS, frame="camera", sample_rate_hz=100.0)
        path = samples(plan)
        assert path.q[-1] == pytest.approx(rotation.exp([0, 0, 0.3]), abs=1e-9)
        assert path.position[-1] == pytest.approx([0, 0.02, 0.1], abs=1e-9)
        # What is kept for everybody is in the coordinates of the device.
        kept = samples(robot.planned(plan.motion_id, sample_rate_hz=100.0))
        # So often that the last report is from shortly before the end.
        handle = robot.move(plan, progress_rate_hz=100.0)
        reports = list(handle)
        assert handle.wait().outcome == pb.OUTCOME_DONE
        q, position = commanded(robot)
    assert to_vector(reports[-1].position) == pytest.approx([0, 0.02, 0.1], abs=1e-3)
    assert rotation.angle(to_quaternion(reports[-1].q), path.q[-1]) < 0.02
    assert q == pytest.approx(kept.q[-1], abs=1e-12)
    turned = rotation.multiply(q, rotation.from_euler("y", [np.pi / 2]))
    assert rotation.angle(turned, rotation.exp([0, 0, 0.3])) < 1e-9
    assert position == pytest.approx(
        np.array([0, 0.02, 0.1]) - rotation.rotate(q, [0, 0, 0.1]), abs=1e-12
    )


def test_a_relative_keyframe_is_seen_from_where_the_tool_is(daemon):
    with orientd.connect(daemon.socket, holder="ana") as robot:
        before_q, before_position = commanded(robot)
        on = {"rotation_vector": [0.2, 0, 0], "position": [0.01, 0, 0], "relative": True}
        robot.move([on]).wait()
        after_q, after_position = commanded(robot)
    assert after_q == pytest.approx(
        rotation.multiply(before_q, rotation.exp([0.2, 0, 0])), abs=1e-9
    )
    step = np.array(after_position) - before_position
    assert step == pytest.approx(rotation.rotate(before_q, [0.01, 0, 0]), abs=1e-9)


def test_an_offline_plan_knows_the_frames_of_both(daemon, tmp_path):
    file, output = tmp_path / "motion.json", tmp_path / "samples.json"
    motion = {"keyframes": TURNS, "frames": {"table": TABLE}, "frame": "table"}
    motion["keyframes"] = [TURNS[0], {**TURNS[1], "frame": "camera"}]
    motion["keyframes"][1]["position"] = [1.0, 0.01, 0.0]
    file.write_text(json.dumps(motion))
    command = [sys.executable, "-m", "orientd", "plan", str(file), "-o", str(output)]
    subprocess.run([*command, "--config", str(daemon.config)], check=True, capture_output=True)
    samples = json.loads(output.read_text())
    first = dict(zip(samples["columns"], samples["rows"][0], strict=True))
    assert [first[f"position_{axis}_m"] for axis in "xyz"] == pytest.approx([0, 0, 0.1])
    assert first["qw"] == pytest.approx(1.0)
