"""`orientd serve rotctld` with a known pass: planned whole, and followed without more positions."""

import math
import os
import signal
import time

import numpy as np
import pytest
from command_line import assert_refused, orientd
from harness import DEVICE, until
from rotator import rotctld

from orientd.client.robot import connect
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import rotate

pytestmark = pytest.mark.world

PERIOD = 0.002
"""Of the device, s."""

SECONDS = 8.0
"""Of the pass."""


def direction(since):
    """A pass past north, up to 70 degrees."""
    share = np.clip(since / SECONDS, 0.0, 1.0)
    return 300.0 + 140.0 * share, 70.0 * np.sin(np.pi * share) + 0.01


def vector(azimuth, elevation):
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), -level * np.sin(azimuth), np.sin(elevation)], -1)


def written(folder, rows):
    """Write a table of times, azimuths and elevations."""
    table = folder / "pass.csv"
    table.write_text("time,azimuth,elevation\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    return table


def test_a_pass_of_a_table_is_planned_whole(daemon, tmp_path):
    """A client asks for the place of the rise alone, and the device follows the table."""
    rise = time.time() + 10.0
    rows = [(rise + t, *direction(t)) for t in np.arange(0.0, SECONDS + 0.1, 0.25)]
    table = written(tmp_path, rows)
    seen = []
    with rotctld(daemon, "--ephemeris", table) as client, connect(daemon.socket) as robot:
        assert client.ask("P 300 0") == ["RPRT 0"]
        cycles = robot.watch(DEVICE, rate_hz=20)
        while time.time() < rise + SECONDS + 0.5:
            seen += next(cycles)
    # The motion begins at its time.  A servo that the machine keeps waiting stays on the path, and
    # goes on from the place that it had: a setpoint counts at its own time of the path.
    sent = [one for one in seen if one.motion == seen[-1].motion and one.path_index > 0]
    places = np.array([one.path_index + one.path_fraction for one in sent])
    begun = 1e-9 * sent[0].deadline_ns + time.time() - time.monotonic() - rise
    since = begun + PERIOD * (places - places[0])
    ahead = rotate(np.array([one.q for one in sent]), [1.0, 0.0, 0.0])
    apart = np.degrees(np.linalg.norm(ahead - vector(*direction(since)), axis=-1))
    is_up = (since > 0.3) & (since < SECONDS - 0.3)
    assert since[is_up].min() < 0.5
    assert since[is_up].max() > SECONDS - 0.5
    assert apart[is_up].max() < 0.2


def test_a_waiting_pass_is_left_for_a_position_elsewhere(daemon, tmp_path):
    """It does not begin later either, and the end of the server does not wait for it."""
    rise = time.time() + 400.0
    rows = [(rise + 5.0 * t, 2.0 * t, 10.0 + t) for t in range(20)]
    table = written(tmp_path, rows)
    with rotctld(daemon, "--ephemeris", table) as client:
        assert client.ask("P 0 10") == ["RPRT 0"]
        assert client.ask("P 100 20") == ["RPRT 0"]
        client.await_position(100.0, 20.0)
        assert client.ask("P 0 10") == ["RPRT 0"]


def test_a_planned_pass_that_waits_is_left_for_a_position_elsewhere(daemon, tmp_path):
    """The daemon has its motion already, which is to begin in minutes."""
    rise = time.time() + 400.0
    table = written(tmp_path, [(rise + 5.0 * t, 2.0 * t, 10.0 + t) for t in range(20)])
    with rotctld(daemon, "--ephemeris", table) as client:
        assert client.ask("P 0 10") == ["RPRT 0"]
        until(lambda: daemon.device().motion_name == "pass", "the pass to be planned")
        assert client.ask("P 100 20") == ["RPRT 0"]
        client.await_position(100.0, 20.0)
        assert client.ask("P 0 10") == ["RPRT 0"]
        until(lambda: daemon.device().motion_name == "pass", "the pass to be planned again")


def test_a_stop_ends_a_planned_pass(daemon, tmp_path):
    rise = time.time() + 1.0
    rows = [(rise + 2.0 * t, 2.0 * t, 30.0) for t in range(100)]
    table = written(tmp_path, rows)
    with rotctld(daemon, "--ephemeris", table) as client:
        time.sleep(max(0.0, rise - time.time()))

        def ask():
            azimuth = 2.0 * (time.time() - rise) / 2.0
            assert client.ask(f"P {azimuth:.2f} 30") == ["RPRT 0"]
            return daemon.device().motion_name == "pass"

        until(ask, "the pass to begin")
        assert client.ask("S") == ["RPRT 0"]
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
        before = client.position()
        assert client.position() == pytest.approx(before, abs=0.01)


def test_a_pass_that_has_fallen_behind_is_planned_again(daemon, tmp_path):
    """A servo that its machine does not run for a while resumes where it was."""
    rise = time.time() + 1.0
    rows = [(rise + 2.0 * t, 8.0 * t, 30.0) for t in range(40)]
    table = written(tmp_path, rows)
    with rotctld(daemon, "--ephemeris", table) as client:

        def off_target():
            azimuth = 4.0 * max(0.0, time.time() - rise)
            assert client.ask(f"P {azimuth:.2f} 30") == ["RPRT 0"]
            device = daemon.device()
            since = time.time() - device.cycle_age - rise
            ahead = rotate(to_quaternion(device.cycle.q), [1.0, 0.0, 0.0])
            return math.degrees(math.dist(ahead, vector(4.0 * since, 30.0)))

        until(lambda: off_target() < 0.1, "the pass to be followed")
        before = daemon.device()
        os.kill(before.servo_pid, signal.SIGSTOP)
        time.sleep(0.4)
        os.kill(before.servo_pid, signal.SIGCONT)
        until(lambda: daemon.device().cycle.index > before.cycle.index, "the servo to run")
        assert off_target() > 1.0
        until(lambda: off_target() < 0.1, "the pass to be followed again")


ISS = """ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
"""
"""An example of the format, from Wikipedia's article on it."""


def test_bad_elements_and_places_are_refused_in_one_line(daemon, tmp_path):
    pytest.importorskip("sgp4")
    file = tmp_path / "sky.tle"

    def serve(*arguments):
        return orientd("serve", "rotctld", "--socket", daemon.socket, *arguments)

    file.write_text("nothing\n")
    done = serve("--tle", file, "--observer", "52.5,13.4")
    assert_refused(done, "expected two-line elements, found none")
    file.write_text(ISS)
    assert_refused(serve("--tle", file, "--observer", "95,13"), "observer", "LAT,LON")
    assert_refused(serve("--tle", file), "--tle and --observer together", status=2)
    done = serve("--tle", tmp_path / "none.tle", "--observer", "52.5,13.4")
    assert_refused(done, "none.tle", "No such file")
