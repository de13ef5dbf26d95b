"""Plans from the command line without a daemon: without the robot, and asking it."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from emulated_ur import EmulatedRobot
from orientd.cli.main import app
from orientd.clock import MonotonicClock
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd_ur import UrDriver

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

CONFIG = Path(__file__).parents[3] / "config"
FAR = "keyframes: [{euler: {axes: ZYX, degrees: [100, 5, 175]}}]\n"


def plan(*words):
    return CliRunner().invoke(app, ["plan", *map(str, words), "--json"])


def configuration(tmp_path, host, **options):
    text = (CONFIG / "ur.toml").read_text().replace("127.0.0.2", host)
    for name, value in options.items():
        text = text.replace(f'\n{name} = "ur5e"', f"\n{value}")
    (tmp_path / "ur.toml").write_text(text)
    return tmp_path / "ur.toml"


def test_example_is_planned_without_a_robot(tmp_path, ur_host):
    done = plan(CONFIG / "ur-turn.yaml", "--config", configuration(tmp_path, ur_host))
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["plan"]["duration"] > 1.0


def test_single_keyframe_is_planned_from_where_the_arm_is_said_to_stand(tmp_path, ur_host):
    (tmp_path / "far.yaml").write_text(FAR)
    done = plan(tmp_path / "far.yaml", "--config", configuration(tmp_path, ur_host))
    assert done.exit_code == 0, done.output


def test_path_whose_joints_are_not_known_begins_where_the_options_say(ur_host):
    begin = [0.3, -1.2, 1.3, -1.5, -1.4, 0.2]
    options = {"host": ur_host, "model": "ur5e", "start_joints": begin}
    driver = UrDriver(options, period_ns=2_000_000, clock=MonotonicClock())
    start = driver.offline_start(from_device=False)
    planner = DevicePlanner(driver, limits=Limits(1.0, 5.0, 100.0, 0.5, 5.0), period=0.002)

    def plan(position):
        request = MotionRequest([Keyframe(start.q, position=position)], approach=True)
        at = State.at_rest(start.q, start.position)
        return planner.plan(request, start=at, joints=(), is_offline=True)

    motion = plan(tuple(x + 0.02 for x in start.position))
    assert motion.facts.first_joints == pytest.approx(begin)
    with pytest.raises(PlanError, match="do not reach the pose"):
        plan((0.0, 0.0, 0.0))


def test_unknown_arm_is_refused_offline_in_words(tmp_path, ur_host):
    config = configuration(tmp_path, ur_host, model="")
    done = plan(CONFIG / "ur-turn.yaml", "--config", config)
    assert done.exit_code == 1
    assert "name `model` in the device's options, or ask the robot" in done.output


def test_robot_is_asked_where_it_stands_and_which_arm_it_is(tmp_path, ur_host):
    config = configuration(tmp_path, ur_host, model="")
    absent = plan(CONFIG / "ur-turn.yaml", "--config", config, "--from-robot")
    assert absent.exit_code == 1
    assert "no RTDE server" in absent.output
    with EmulatedRobot(ur_host, "--model", "ur16e"):
        done = plan(CONFIG / "ur-turn.yaml", "--config", config, "--from-robot")
    assert done.exit_code == 0, done.output
