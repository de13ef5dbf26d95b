"""LeRobot itself drives a loopback device of a real daemon."""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from lerobot.robots import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot.utils.import_utils import register_third_party_plugins

from orientd import Playing
from orientd.errors import RequestError


@pytest.fixture(scope="module")
def socket(tmp_path_factory):
    folder = tmp_path_factory.mktemp("daemon")
    socket, config = folder / "control.sock", folder / "config.toml"
    config.write_text(f'[daemon]\nsocket = "{socket}"\n\n[devices.arm]\ndriver = "loopback"\n')
    command = [sys.executable, "-m", "orientd", "run", "--config", str(config)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as daemon:
        assert "ready" in daemon.stdout.readline()
        yield str(socket)
        daemon.terminate()
        daemon.communicate()


@pytest.fixture
def made(socket, tmp_path):
    register_third_party_plugins()
    config = RobotConfig.get_choice_class("orientd")(socket=socket, calibration_dir=tmp_path)
    return make_robot_from_config(config)


@pytest.fixture
def robot(made):
    with made as robot:
        yield robot


def pose(z=0.0, turn=0.0):
    return {**dict.fromkeys(("ee.x", "ee.y", "ee.wx", "ee.wy"), 0.0), "ee.z": z, "ee.wz": turn}


def observed_until(robot, is_there, during=lambda: None):
    end = time.monotonic() + 60.0
    while not is_there(observation := robot.get_observation()):
        assert time.monotonic() < end, observation
        during()
        time.sleep(0.02)
    return observation


def rests(robot):
    before = robot.get_observation()
    time.sleep(0.1)
    after = robot.get_observation()
    return all(abs(after[name] - before[name]) < 1e-9 for name in robot.action_features)


def test_lerobot_finds_the_robot_by_its_type(made):
    assert made.robot_type == "orientd"
    assert not made.is_connected
    with pytest.raises(DeviceNotConnectedError):
        made.get_observation()


def test_a_command_of_lerobot_takes_the_type(socket):
    command = [sys.executable, "-m", "lerobot.scripts.lerobot_calibrate", "--robot.type=orientd"]
    done = subprocess.run([*command, f"--robot.socket={socket}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_program_of_the_guide_reaches_its_target(socket):
    program = Path(__file__).parents[1] / "drive.py"
    environ = {**os.environ, "ORIENTD_SOCKET": socket}
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, env=environ, check=False
    )
    assert "'ee.z': 0.02" in done.stdout, done.stderr
    assert "'ee.wz': 0.3" in done.stdout


def test_an_action_is_followed_and_observed_with_its_age(robot):
    target = pose(z=0.02, turn=0.3)

    def send():
        assert robot.send_action(target) == target

    observation = observed_until(
        robot, lambda seen: all(abs(seen[k] - target[k]) < 1e-4 for k in target), send
    )
    assert observation.keys() == robot.observation_features.keys()
    assert robot.action_features.keys() == target.keys()
    assert observation["ee.age"] >= 0.0


def test_an_action_is_due_one_period_after_it_is_sent(robot, monkeypatch):
    stamps = []
    monkeypatch.setattr(Playing, "aim", lambda *_, time_ns, **__: stamps.append(time_ns))
    sent_ns = time.monotonic_ns()
    robot.send_action(pose())
    period_ns = round(1e9 / robot.config.fps)
    assert sent_ns + period_ns <= stamps[0] <= time.monotonic_ns() + period_ns


def test_a_rate_that_is_none_is_refused():
    with pytest.raises(ValueError, match="fps: expected more than 0, got 0"):
        RobotConfig.get_choice_class("orientd")(fps=0)


@pytest.mark.parametrize("name", ["ee.x", "ee.wz"])
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_an_action_that_is_not_finite_is_refused(robot, name, number):
    with pytest.raises(RequestError, match=f"{name}: expected a finite number, got {number}"):
        robot.send_action({**pose(), name: number})


def test_without_a_new_action_the_device_comes_to_rest(robot):
    begin = robot.get_observation()["ee.wz"]
    robot.send_action(pose(turn=begin - 2.5))
    observed_until(robot, lambda seen: seen["ee.wz"] < begin - 1e-3)
    observed_until(robot, lambda _: rests(robot))
    assert robot.get_observation()["ee.wz"] > begin - 2.4


def test_a_chunk_is_played_to_its_last_pose(robot):
    begin = robot.get_observation()
    chunk = [{**begin, "ee.wz": begin["ee.wz"] + 0.01 * k} for k in range(16)]
    robot.send_chunk(chunk, rate=30.0)
    observed_until(robot, lambda seen: abs(seen["ee.wz"] - chunk[-1]["ee.wz"]) < 1e-4)
