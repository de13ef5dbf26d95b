"""Gateways that are killed, hang or come late, and daemons that do: each leaves the other alone."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from fleet_cell import CELL, RunningCell, gateway_of, hanging
from harness import until

import orientd
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb

pytest.importorskip("zenoh")

LONG = parse({"keyframes": [{"rotation_vector": [0, 0, 3.0]}], "limits": {"velocity": 0.3}})
HOME = {"keyframes": [{"rotation_vector": [0, 0, 0]}]}
GATEWAY = gateway_of("arm-1")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 1) as cell:
        yield cell


@pytest.fixture
def robot(cell):
    """A client of the daemon's own socket."""
    with orientd.connect(cell.control("arm-1")) as robot:
        yield robot


def serve_again(cell):
    cell.start_gateway("arm-1")
    cell.await_ready(GATEWAY)


def assert_is_commanded(robot):
    """Check that the daemon takes and gives leases, moves, and stops on the path."""
    robot.acquire_lease()
    move = robot.move(LONG)
    until(lambda: robot.state().devices["arm"].state == pb.STATE_STREAMING, "a motion")
    robot.stop()
    assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED
    assert robot.move(parse(HOME)).wait(20.0).outcome == pb.OUTCOME_DONE
    robot.release_lease()
    assert not robot.state().daemon.leases


def test_what_moves_goes_on_when_the_gateway_is_killed(cell, robot):
    move = robot.move(LONG)
    cell.end(GATEWAY, signal.SIGKILL)
    try:
        with pytest.raises(TimeoutError):
            move.wait(2.0 * cell.lease)  # for longer than its lease lasts by itself
        assert len(robot.state().daemon.leases) == 1
    finally:
        serve_again(cell)
    with cell.fleet() as fleet:
        (stopped,) = fleet.stop()
    assert (stopped.problem, stopped.devices[0]["state"]) == ("", "STREAMING")
    assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED
    assert_is_commanded(robot)


def test_a_gateway_that_hangs_leaves_the_daemon_alone_and_the_next_one_serves(cell, robot):
    watching = cell.fleet()  # the daemon's state is asked for when the gateway stops
    try:
        heard = []
        watching.subscribe("state", heard.append)
        until(lambda: heard, "a state")
        with hanging(cell, GATEWAY):
            assert_is_commanded(robot)
            cell.end(GATEWAY, signal.SIGKILL)
            serve_again(cell)
    finally:
        watching.close()
    with cell.fleet() as fleet:
        assert [one.problem for one in fleet.stop()] == [""]


def test_a_daemon_without_a_gateway_is_complete_and_a_late_one_finds_it(cell, robot):
    cell.end(GATEWAY)
    assert_is_commanded(robot)
    serve_again(cell)
    with cell.fleet() as fleet:
        assert fleet.daemons == ["arm-1"]


def test_a_restart_of_the_daemon_has_the_settings_read_again(cell):
    cell.end("arm-1")
    config = cell.folder / "arm-1.toml"
    cell.start("arm-1")
    cell.await_ready("arm-1")
    until(lambda: "fleet: reload: nothing has changed" in cell.log(GATEWAY), "the log")
    before = config.read_text()
    config.write_text(before.replace("[fleet]", "[fleet]\nstate_hz = 5.0"))
    try:
        cell.end("arm-1")
        cell.start_again("arm-1")
        cell.await_ready("arm-1")
        until(lambda: "fleet: reload: joins the cell again" in cell.log(GATEWAY), "the log")
        with cell.fleet() as fleet:
            assert fleet.daemons == ["arm-1"]
    finally:
        config.write_text(before)


def test_a_gateway_waits_for_its_daemon(cell):
    cell.end(GATEWAY)
    cell.end("arm-1")
    serve_again(cell)
    until(lambda: "fleet: waits for a daemon at " in cell.log(GATEWAY), "the log")
    cell.start("arm-1")
    cell.await_ready("arm-1")
    with cell.fleet() as fleet:
        assert [one.problem for one in fleet.stop()] == [""]


def test_a_daemon_that_hangs_is_present_and_its_devices_stop(cell, robot):
    with cell.fleet() as fleet:
        heard = []
        fleet.subscribe("state", heard.append)
        until(lambda: heard, "a state")
        move = robot.move(LONG)
        with hanging(cell, "arm-1"):
            (stopped,) = fleet.stop()
            until(lambda: "fleet: no state: " in cell.log(GATEWAY), "the log")
            assert fleet.daemons == ["arm-1"]
        assert stopped.devices[0]["state"] == "STREAMING"
        assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED
        before = len(heard)
        until(lambda: len(heard) > before, "states again")


def test_a_daemon_that_is_killed_has_left_and_no_stop_waits_for_it(cell):
    with cell.fleet() as fleet:
        cell.end("arm-1", signal.SIGKILL)
        until(lambda: not fleet.daemons, "it has left", 5.0)
        assert fleet.stop(timeout=0.5) == []
        cell.start("arm-1")
        cell.await_ready("arm-1")
        until(lambda: fleet.daemons == ["arm-1"], "it is back")
        assert [one.problem for one in fleet.stop()] == [""]


def test_a_daemon_knows_nothing_of_its_cell(cell):
    loaded = Path(f"/proc/{cell.processes['arm-1'].pid}/maps").read_text()
    assert "zenoh" not in loaded
    assert "[fleet] is read by `orientd fleet serve`, not by the daemon" in cell.log("arm-1")


def test_the_socket_of_the_daemon_can_be_named(tmp_path):
    tmp_path.chmod(0o700)
    config, socket = tmp_path / "orientd.toml", tmp_path / "other.sock"
    config.write_text(
        f'[fleet]\ncell = "{CELL}"\nname = "a"\nlisten = ["unixsock-stream/{tmp_path}/a"]\n'
        '[devices.arm]\ndriver = "loopback"\n'
    )
    command = [sys.executable, "-m", "orientd", "fleet", "serve", "-c", config, "--json"]
    with subprocess.Popen([*command, "--socket", socket], stdout=subprocess.PIPE) as gateway:
        content = json.loads(gateway.stdout.readline())
        gateway.terminate()
    assert content == {"ready": True, "cell": CELL, "name": "a", "socket": str(socket)}
    assert gateway.returncode == 0


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ("", "fleet: missing"),
        ('[fleet]\ncell = "lab"\nname = "a"\nlisten = ["tcp/h:1"]\n', "fleet.listen[0]: expected"),
    ],
)
def test_settings_that_do_not_suffice_are_refused_in_one_line(tmp_path, table, problem):
    config = tmp_path / "orientd.toml"
    config.write_text(f'{table}[devices.arm]\ndriver = "loopback"\n')
    command = [sys.executable, "-m", "orientd", "fleet", "serve", "-c", config]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(f"orientd: {config}: {problem}")


def test_a_gateway_ends_when_told_to_although_no_router_is_there(tmp_path):
    tmp_path.chmod(0o700)
    config = tmp_path / "orientd.toml"
    config.write_text(
        f'[fleet]\ncell = "{CELL}"\nname = "a"\nconnect = ["unixsock-stream/{tmp_path}/none"]\n'
        '[devices.arm]\ndriver = "loopback"\n'
    )
    command = [sys.executable, "-m", "orientd", "fleet", "serve", "-c", config]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as gateway:
        with pytest.raises(subprocess.TimeoutExpired):
            gateway.wait(5.0)
        gateway.terminate()
        assert gateway.wait(10.0) == 0
