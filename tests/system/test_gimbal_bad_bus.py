"""A gimbal whose servos are blocked, misread or start again: what the commands and Python say."""

import json

import pytest
from command_line import orientd
from gimbal_bench import GimbalDaemon, await_hold
from harness import until

from orientd import connect
from orientd.protocol import control_pb2 as pb

pytest.importorskip("dynamixel_sdk")

pytestmark = pytest.mark.world


@pytest.fixture
def daemon(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link)
    it.start()
    await_hold(it, "gimbal")
    yield it
    it.end()


def motion(tmp_path, yaw):
    path = tmp_path / "move.yaml"
    keyframe = f"{{euler: {{axes: ZYX, degrees: [{yaw}, 0, 0]}}}}"
    path.write_text(f"keyframes:\n  - {keyframe}\napproach: true\n")
    return path


def test_blocked_shaft_is_told_by_exit_status_json_and_python(bus, daemon, tmp_path):
    bus.tell("stops 1 1000 2389")  # 30 degrees
    path = motion(tmp_path, 33)
    done = orientd("move", path, "--json", "--socket", daemon.socket)
    assert done.returncode == 1
    text = "servo 1 (yaw) has not arrived: it is 3.0 deg behind the end of the motion 0.5 s after"
    told = json.loads(done.stdout)["summary"]
    assert told["outcome"] == "fault"
    assert text in told["text"]
    assert text in done.stderr
    assert bus.state(1)["torque"] == 1
    until(lambda: abs(bus.state(1)["goal"] - 2389) < 6, "a goal where the servo stands")
    await_hold(daemon, "gimbal")
    with connect(daemon.socket) as robot:
        keyframe = {"euler": {"axes": "ZYX", "degrees": [34, 0, 0]}}
        summary = robot.move([keyframe], approach=True).wait(20)
        assert summary.outcome == pb.OUTCOME_FAULT
        assert "has not arrived" in summary.text


def test_servo_that_misreads_a_tick_is_a_fault_in_which_nothing_moves(bus, daemon, tmp_path):
    bus.tell("misread 1 4095 -4095")
    orientd("move", motion(tmp_path, 179.91), "--socket", daemon.socket)
    with connect(daemon.socket) as robot:
        until(lambda: robot.state().devices["gimbal"].state == pb.STATE_FAULT, "the fault")
        robot.stop()
        assert bus.state(1)["goal"] == 4095
        robot.disable("gimbal")
        assert robot.state().devices["gimbal"].state == pb.STATE_FAULT
    assert bus.state(1)["goal"] == 4095
