"""A gimbal of the order ZXY points behind itself, whichever program asks."""

import json
import signal

import pytest
from command_line import begin, orientd
from gimbal_bench import GimbalDaemon, await_hold
from harness import until
from rotator import rotctld

from orientd import connect

pytest.importorskip("dynamixel_sdk")

pytestmark = pytest.mark.world

ORDER = (
    ('order = "ZYX"', 'order = "ZXY"'),
    ('name = "pitch"', 'name = "middle"'),
    ("limits_deg = [-100, 100]", "limits_deg = [-120, 120]  # roll"),
    ('name = "roll"', 'name = "pitch"'),
    ("limits_deg = [-120, 120]\n", "limits_deg = [-100, 100]\n"),
    ('name = "middle"', 'name = "roll"'),
)
BEHIND = {"azimuth_elevation": {"azimuth": 180, "elevation": 45}}


@pytest.fixture
def daemon(bus, tmp_path):
    it = GimbalDaemon(tmp_path, bus.link, *ORDER).start()
    await_hold(it, "gimbal")
    yield it
    it.end()


def await_behind(bus):
    """Wait until yaw is at 180 degrees to either side, pitch at 45 up, and roll at 0."""

    def is_there():
        yaw, roll, pitch = (
            (bus.state(servo)["goal"] - 2048) * 360.0 / 4096.0 for servo in (1, 2, 3)
        )
        return max(abs(abs(yaw) - 180.0), abs(roll), abs(pitch + 45.0)) < 0.3

    until(is_there, "180 degrees of yaw, 45 up")


def test_by_a_file_and_by_python(bus, daemon, tmp_path):
    motion = tmp_path / "behind.json"
    motion.write_text(json.dumps({"keyframes": [BEHIND], "approach": True}))
    done = orientd("move", motion, "--socket", daemon.socket)
    assert (done.returncode, done.stderr) == (0, ""), done
    await_behind(bus)
    with connect(daemon.socket) as robot:
        robot.home().wait(30)
        robot.move([BEHIND], approach=True).wait(30)
    await_behind(bus)


def test_by_rotctl(bus, daemon):
    with rotctld(daemon) as client:
        assert client.ask("P 180 45") == ["RPRT 0"]
        await_behind(bus)


def test_by_mavlink(bus, daemon):
    pytest.importorskip("pymavlink")
    from mavlink_station import ACCEPTED, gimbal

    with gimbal(daemon.socket) as station:
        station.take_control()
        assert station.point(45, 180) == ACCEPTED
        await_behind(bus)
        assert station.point(0, 0) == ACCEPTED
        station.await_attitude(0, 0, 0)
        station.stream(45, 180)
        await_behind(bus)
        station.release()


def test_by_alpaca(bus, daemon):
    telescope = pytest.importorskip("alpaca.telescope")
    served = begin(
        "serve", "alpaca", "--port", 0, "--discovery", 0, "--socket", daemon.socket
    )  # fmt: skip
    line = served.stdout.readline()
    assert line.startswith("ready at "), (line, served.stderr.read())
    mount = telescope.Telescope(line.split()[2], 0)
    mount.Connected = True
    mount.SlewToAltAzAsync(180.0, 45.0)
    await_behind(bus)
    served.send_signal(signal.SIGINT)
    _, errors = served.communicate(timeout=30.0)
    assert (served.returncode, errors) == (0, "")
