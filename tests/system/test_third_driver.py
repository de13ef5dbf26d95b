"""A driver of another package, with servos that share no code with it, moves by a daemon."""

import math
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import begin, environment, orientd
from gimbal_bench import STEADY, seldom
from harness import until

from orientd import connect
from orientd.driver import AxisLimits
from orientd.floats import difference, exp, norm
from orientd.mechanism import Gimbal
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion

PACKAGE = Path(__file__).parents[2] / "examples" / "feetech_gimbal"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return a folder with the example gimbal, installed as a user would."""
    folder = tmp_path_factory.mktemp("site")
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([sys.executable, *install, "--target", folder, PACKAGE], check=True)
    return folder


@pytest.fixture
def gimbal(site, tmp_path):
    """A daemon with the example gimbal, on emulated servos."""
    servos = subprocess.Popen(
        [sys.executable, PACKAGE / "tests" / "emulated_servos.py", tmp_path / "bus"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert servos.stdout.readline() == "ready\n"
    config = tmp_path / "feetech.toml"
    text = (PACKAGE / "feetech.toml").read_text().replace("/tmp/feetech", str(tmp_path / "bus"))
    text = text.replace("feedback_timeout = 0.5 ", f"{STEADY}5.0 ")
    config.write_text(f'[daemon]\nsocket = "{tmp_path}/control.sock"\n{text}')
    env = environment(PYTHONPATH=str(site), XDG_STATE_HOME=str(tmp_path / "state"))
    daemon = begin("run", "--config", config, env=env)
    try:
        assert daemon.stdout.readline().startswith("ready at")
        yield config, env
    finally:
        daemon.terminate()
        daemon.communicate(timeout=30)
        servos.terminate()
        servos.communicate(timeout=30)


def is_near(robot, q, degrees):
    """Return whether the gimbal was measured that near an orientation."""
    measured = to_quaternion(robot.state().devices["gimbal"].cycle.feedback_q)
    return norm(difference(q, measured)) < math.radians(degrees)


def test_it_moves_and_says_how_it_is(gimbal):
    config, env = gimbal
    with connect(config.parent / "control.sock") as robot:
        target = {"euler": {"axes": "ZYX", "degrees": [40, 20, -10]}}
        assert robot.move([target]).wait().outcome == pb.OUTCOME_DONE
        assert robot.state().devices["gimbal"].state == pb.STATE_HOLDING
        joints = tuple(map(math.radians, (40, 20, -10)))
        q, _ = Gimbal([AxisLimits(name, -3.0, 3.0, 1.0) for name in "abc"]).forward(joints)
        until(seldom(lambda: is_near(robot, q, 0.3)), "the target")
        # The servo asks for it once a second.
        health = until(seldom(lambda: robot.state().devices["gimbal"].health), "the health")
        assert [part.name for part in health] == ["yaw", "pitch", "roll"]
    assert "12.1 V" in orientd("status", "--socket", config.parent / "control.sock", env=env).stdout


@pytest.mark.parametrize("stop", ["stop", "halt"])
def test_a_stop_in_motion_comes_to_rest(gimbal, stop):
    config, _ = gimbal
    with connect(config.parent / "control.sock") as robot:
        target = {"euler": {"axes": "ZYX", "degrees": [120, 0, 0]}}
        handle = robot.move([target], limits={"velocity": 0.2})
        next(iter(handle))
        getattr(robot, stop)()
        assert handle.wait(check=False).outcome == pb.OUTCOME_STOPPED
        assert robot.state().devices["gimbal"].state == pb.STATE_HOLDING


def test_it_follows_targets(gimbal):
    config, _ = gimbal
    with connect(config.parent / "control.sock") as robot, robot.track() as tracking:

        def is_there():
            tracking.aim({"rotation_vector": [0.0, 0.0, 0.3]}, time_to_live=2.0)
            return is_near(robot, exp((0.0, 0.0, 0.3)), 0.5)

        until(seldom(is_there), "the target")
