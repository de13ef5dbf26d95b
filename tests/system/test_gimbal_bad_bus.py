"""A gimbal whose servos are blocked: what the commands and Python say."""

import json

import pytest
from command_line import orientd
from gimbal_bench import GimbalDaemon, await_hold
from harness import until

from orientd import connect
from orientd.errors import MotionFault
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
        with pytest.raises(MotionFault, match="has not arrived") as raised:
            robot.move([keyframe], approach=True).wait(20)
        assert raised.value.summary.outcome == pb.OUTCOME_FAULT
