"""A gimbal from the command line: an emulated bus, the daemon, motions."""

import json
import os
import signal
import time

import numpy as np
import pytest
from command_line import assert_refused, orientd
from gimbal_bench import ROOT, GimbalDaemon, await_hold
from harness import until

from orientd import connect
from orientd.motion_file import load
from orientd.protocol import control_pb2 as pb

pytest.importorskip("dynamixel_sdk")

pytestmark = pytest.mark.world


@pytest.fixture
def daemon(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link).start()
    await_hold(it, "gimbal")
    yield it
    it.end()


def ticks(degrees):
    return 2048 + degrees * 4096 / 360


def test_three_commands_turn_an_emulated_gimbal(bus, daemon):
    motion = ROOT / "config" / "gimbal-turn.yaml"
    done = orientd("move", motion, "--socket", daemon.socket)
    assert (done.returncode, done.stderr) == (0, ""), done
    assert "yaw: 0.0 to 7" in done.stdout
    with connect(daemon.socket) as robot:
        _, outline = next(robot.observe().sight())
    # Pins and rings of three axes; the yaw is about the vertical.
    assert [len(line) for line in outline] == [2, 2, 25] * 3
    assert outline[0] == pytest.approx(np.array([[0, 0, 0.15], [0, 0, 0.12]]), abs=1e-6)
    for servo, degrees in ((1, 60), (2, 20), (3, -15)):
        state = bus.state(servo)
        assert abs(state["goal"] - ticks(degrees)) <= 0.5 + 1e-6
        # The emulated servo trails its goal by a lag of 20 ms; it is still settling.
        assert abs(state["position"] - state["goal"]) <= 12


def test_a_turn_without_a_duration_ends_near_the_end_of_a_range(bus, tmp_path):
    daemon = GimbalDaemon(tmp_path, bus.link, ("[-270, 270]", "[-80, 80]")).start()
    await_hold(daemon, "gimbal")
    done = orientd("turn", "--rate", 0.5, "--socket", daemon.socket)
    assert_refused(done, "the turn could not continue", "angle of yaw", "the limit is 1.39626 rad")
    assert ticks(60) < bus.state(1)["goal"] <= ticks(80)
    daemon.end()


WIDE = (
    ("limits_deg = [-100, 100]", "limits_deg = [-200, 200]"),
    ("limits_deg = [-120, 120]", "limits_deg = [-200, 200]"),
)


@pytest.fixture
def deviating(bus, tmp_path):
    """A gimbal that may pass by the pole and miss its path by up to 3 degrees."""
    deviation = ("max_deviation_deg = 0.0", "max_deviation_deg = 3.0")
    it = GimbalDaemon(tmp_path, bus.link, *WIDE, deviation).start()
    await_hold(it, "gimbal")
    yield it
    it.end()


@pytest.fixture
def exact(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link, *WIDE).start()
    yield it
    it.end()


@pytest.fixture
def over_the_top(tmp_path):
    """Turn over by 150 degrees in 8 s, missing the pole by 2 degrees."""
    miss = np.deg2rad(2.0)
    axis = np.array([0, -np.cos(miss), np.sin(miss)])
    keyframes = [
        {"rotation_vector": (np.deg2rad(sweep) * axis).tolist(), "time": 8 * sweep / 150}
        for sweep in np.linspace(0, 150, 7)
    ]
    path = tmp_path / "over.json"
    path.write_text(json.dumps({"keyframes": keyframes, "approach": True}))
    return path


def test_plan_without_a_daemon_certifies_the_axes_as_the_daemon_does(bus, deviating, over_the_top):
    done = orientd("plan", over_the_top, "--json", "--config", deviating.config)
    assert (done.returncode, done.stderr) == (0, ""), done
    alone = json.loads(done.stdout)["plan"]["certificate"]
    with connect(deviating.socket) as robot:
        with_daemon = robot.plan(load(over_the_top)).certificate
    ours = {one["name"]: one["value"] for one in alone["figures"]}
    theirs = {one.name: one.value for one in with_daemon.figures}
    assert {"velocity of yaw", "acceleration of pitch", "largest angle of roll"} < set(ours)
    assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-9)
    assert alone["notes"] == list(with_daemon.notes)
    shown = orientd("plan", over_the_top, "--config", deviating.config).stdout
    assert "pass near the pole, missing by at most 2.0" in shown
    assert "yaw: " in shown


def test_path_that_the_axes_cannot_follow_is_refused_and_nothing_moves(bus, exact, over_the_top):
    before = [bus.state(servo)["goal"] for servo in (1, 2, 3)]
    done = orientd("move", over_the_top, "--socket", exact.socket)
    assert_refused(
        done, "velocity of yaw reaches 9.", "the limit is 3.8397", "20.0 s in place of 8.0 s"
    )
    assert [bus.state(servo)["goal"] for servo in (1, 2, 3)] == before


def test_gimbal_is_released_when_the_daemon_ends_in_order(bus, tmp_path):
    daemon = GimbalDaemon(tmp_path, bus.link).start()
    assert [bus.state(servo)["torque"] for servo in (1, 2, 3)] == [1, 1, 1]
    assert daemon.end()[0] == 0
    assert [bus.state(servo)["torque"] for servo in (1, 2, 3)] == [0, 0, 0]


def test_gimbal_goes_on_holding_when_the_daemon_is_killed(bus, tmp_path):
    daemon = GimbalDaemon(tmp_path, bus.link).start()
    daemon.end(signal.SIGKILL)
    # The servo process writes down why it ended once it has let go of the port.
    until(daemon.report.exists, "the report of the servo")
    assert json.loads(daemon.report.read_text())["reason"] == "the daemon is gone"
    for servo in (1, 2, 3):
        state = bus.state(servo)
        assert (state["torque"], state["watchdog"]) == (1, 0)
        assert abs(state["goal"] - state["position"]) <= 2
    again = GimbalDaemon(tmp_path, bus.link).start()
    again.end()


def test_a_disabled_gimbal_goes_on_holding_without_its_servo_process(bus, daemon):
    with connect(daemon.socket) as robot:
        robot.disable("gimbal")
        before = [bus.state(servo) for servo in (1, 2, 3)]
        assert [(state["torque"], state["watchdog"]) for state in before] == [(1, 0)] * 3
        os.kill(robot.state().devices["gimbal"].servo_pid, signal.SIGKILL)
        time.sleep(3.0)  # longer than any watchdog that these daemons set
        assert [bus.state(servo) for servo in (1, 2, 3)] == before


@pytest.mark.real
def test_emulated_bus_leaves_files_alone(tmp_path):
    (tmp_path / "bus").write_text("mine")
    done = orientd("sim", "dynamixel", "--link", tmp_path / "bus")
    assert_refused(done, "is not a symbolic link")
    assert (tmp_path / "bus").read_text() == "mine"


def test_gimbal_goes_on_from_the_zenith_and_home(bus, daemon):
    # Each way from there, with two axes and with three, is planned in unit/driver_dynamixel.
    with connect(daemon.socket) as robot:
        for azimuth, elevation in ((100, 80), (100, 90), (0, 45), (0, 90)):
            aim = {"azimuth_elevation": {"azimuth": azimuth, "elevation": elevation}}
            assert robot.move([aim], approach=True).wait(60.0).outcome == pb.OUTCOME_DONE
    assert orientd("home", "--socket", daemon.socket).returncode == 0
    for servo in (1, 2, 3):
        assert abs(bus.state(servo)["goal"] - ticks(0)) <= 1
