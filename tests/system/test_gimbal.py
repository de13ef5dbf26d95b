"""A gimbal from the command line: an emulated bus, the daemon, motions."""

import signal

import pytest
from command_line import assert_refused, orientd
from gimbal_bench import ROOT, EmulatedGimbal, GimbalDaemon

pytest.importorskip("dynamixel_sdk")


@pytest.fixture
def bus(tmp_path):
    it = EmulatedGimbal(tmp_path / "bus")
    yield it
    it.end()


@pytest.fixture
def daemon(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link).start()
    yield it
    it.end()


def ticks(degrees):
    return 2048 + degrees * 4096 / 360


def test_three_commands_turn_an_emulated_gimbal(bus, daemon):
    motion = ROOT / "config" / "gimbal-turn.yaml"
    done = orientd("move", motion, "--socket", daemon.socket)
    assert (done.returncode, done.stderr) == (0, ""), done
    for servo, degrees in ((1, 60), (2, 20), (3, -15)):
        state = bus.state(servo)
        assert abs(state["goal"] - ticks(degrees)) <= 0.5 + 1e-6
        # The emulated servo trails its goal by a lag of 20 ms; it is still settling.
        assert abs(state["position"] - state["goal"]) <= 12


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_emulated_bus_ends_cleanly(tmp_path, number):
    bus = EmulatedGimbal(tmp_path / "bus")
    assert bus.link.is_symlink()
    assert bus.end(number) == 0
    assert not bus.link.is_symlink()


def test_emulated_bus_refuses_servos_it_does_not_know(tmp_path):
    done = orientd("sim", "dynamixel", "--link", tmp_path / "bus", "--servos", "1:mx28")
    assert done.returncode == 2
    assert "'1:mx28'" in done.stderr


def test_emulated_bus_leaves_files_alone(tmp_path):
    (tmp_path / "bus").write_text("mine")
    done = orientd("sim", "dynamixel", "--link", tmp_path / "bus")
    assert_refused(done, "is not a symbolic link")
    assert (tmp_path / "bus").read_text() == "mine"
