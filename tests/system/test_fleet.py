"""A cell of real daemons with a real router between them: who may do what, and what ends how."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from authority import OPENSSL, Authority
from command_line import begin
from command_line import orientd as orientd_command
from fleet_cell import CELL, RunningCell, gateway_of, hanging
from harness import until

import orientd
from orientd.errors import AccessError, DaemonError, StateError
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd_fleet import client
from orientd_fleet.client import connect_fleet
from orientd_fleet.together import FleetMotion, move_together

pytest.importorskip("zenoh")
pytestmark = pytest.mark.skipif(OPENSSL is None, reason="there is no openssl here")

LONG = parse({"keyframes": [{"rotation_vector": [0, 0, 3.0]}], "limits": {"velocity": 0.3}})


def turn(angle):
    return parse({"keyframes": [{"rotation_vector": [0.0, 0.0, angle]}]})


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 2, is_tls=True) as cell:
        yield cell


@pytest.fixture
def fleet(cell):
    with cell.fleet() as fleet:
        yield fleet
        fleet.stop()


def poses(cell):
    """Return what each device is commanded to, by the control sockets."""
    found = {}
    for name in cell.names:
        with orientd.connect(cell.control(name)) as robot:
            (device,) = robot.state().devices.values()
            q = to_quaternion(device.cycle.q)
            found |= {f"{name} {axis}": part for axis, part in zip("wxyz", q, strict=True)}
    return found


def are_at_rest(cell):
    for name in cell.names:
        with orientd.connect(cell.control(name)) as robot:
            report = robot.state()
            (device,) = report.devices.values()
            if device.state != pb.STATE_HOLDING or report.daemon.leases:
                return False
    return True


def options_of(cell, name):
    """Return the options of a command that is given with somebody's certificate."""
    files = cell.files(name)
    who = ("--cert", files["certificate"], "--key", files["key"], "--ca", files["ca"])
    return ("--connect", cell.endpoint, "--cell", CELL, *who)


def test_status_shows_every_daemon_and_the_age_of_its_figures(cell):
    done = orientd_command("fleet", "status", "--once", "--json", *options_of(cell, "watcher"))
    told = {one["daemon"]: one for one in json.loads(done.stdout)["daemons"]}
    assert list(told) == cell.names
    for one in told.values():
        assert one["alive"]
        assert one["age"] + one["age_bound"] > 0.0
        assert [device["name"] for device in one["devices"]] == ["arm"]


def test_one_stop_ends_every_motion_and_is_acknowledged_by_each(cell, fleet):
    robots = [fleet.robot(name) for name in cell.names]
    moves = [robot.move(LONG) for robot in robots]
    told = {one.daemon: one for one in fleet.stop()}
    assert list(told) == cell.names
    for name, move, robot in zip(cell.names, moves, robots, strict=True):
        assert told[name].problem == ""
        assert told[name].devices[0]["state"] == "STREAMING"
        assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED
        robot.close()
        line = "fleet: stop by certificate:pendant: arm"
        until(lambda name=name, line=line: line in cell.log(gateway_of(name)), "the log")


def test_a_stop_that_a_daemon_does_not_acknowledge_fails_and_names_it(cell):
    with hanging(cell, gateway_of("arm-2")):
        done = orientd_command("fleet", "stop", "--halt", *options_of(cell, "pendant"))
    assert done.returncode == 1
    assert done.stdout.startswith("arm-1: arm (")
    assert done.stderr == "orientd: arm-2: has not acknowledged the stop\n"


def test_a_daemon_that_hangs_is_stopped_all_the_same(cell, fleet):
    with fleet.robot("arm-1") as robot:
        move = robot.move(LONG)
        with hanging(cell, "arm-1"):
            told = {one.daemon: one for one in fleet.stop()}
        assert told["arm-1"].devices[0]["state"] == "STREAMING"
        assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED


def test_the_offset_of_a_clock_is_within_its_bound(cell, fleet):
    for name in cell.names:
        offset = fleet.clock(name).measure()
        assert abs(offset.ns) <= offset.bound_ns  # all on the clock of one machine


def test_motions_start_together_and_tell_their_skew(cell, fleet):
    together = move_together(fleet, [FleetMotion(name, "", turn(0.2)) for name in cell.names])
    assert together.problem == ""
    assert [one.summary.outcome for one in together.ended] == [pb.OUTCOME_DONE] * 2
    assert together.skew >= 0.0
    assert together.skew_bound > 0.0


def test_a_start_that_one_is_too_late_for_is_given_again(cell, fleet):
    daemon, told = cell.processes["arm-2"].pid, []
    before = poses(cell)

    def tell(what):
        told.append(what)
        if what.startswith("starting") and len(told) < 4:
            os.kill(daemon, signal.SIGSTOP)
        elif "once more" in what:
            os.kill(daemon, signal.SIGCONT)
            assert poses(cell) == pytest.approx(before, abs=1e-9)

    together = move_together(
        fleet, [FleetMotion(name, "", turn(0.3)) for name in cell.names], tell=tell
    )
    assert together.problem == ""
    assert [line for line in told if line.startswith("arm-2: the motion was not armed in time")]


def test_none_moves_where_one_cannot(cell, fleet):
    with orientd.connect(cell.control("arm-2")) as robot:
        robot.disable()
    before = poses(cell)
    try:
        with pytest.raises(StateError, match=r"arm-2.*idle"):
            move_together(fleet, [FleetMotion(name, "", turn(0.5)) for name in cell.names])
    finally:
        with orientd.connect(cell.control("arm-2")) as robot:
            robot.enable()
    assert poses(cell) == pytest.approx(before, abs=1e-9)
    until(lambda: are_at_rest(cell), "leases given back")


KILLED = """
import sys
sys.path[:0] = sys.argv[1:3]
from pathlib import Path
from orientd_fleet.together import FleetMotion, move_together
from orientd_fleet.client import connect_fleet
from orientd.motion_file import parse
files = {name: Path(path) for name, path in zip(("certificate", "key", "ca"), sys.argv[4:7])}
fleet = connect_fleet(sys.argv[3], cell="lab", wait_for=sys.argv[7:], **files)
request = parse({"keyframes": [{"rotation_vector": [0, 0, 0.9]}]})
def tell(what):
    # It says that all move when all are armed: that is long before they do.
    print(what.replace("moving", "armed"), flush=True)
move_together(fleet, [FleetMotion(name, "", request) for name in sys.argv[7:]],
              start_in=2.5, tell=tell)
"""


@pytest.mark.parametrize("moment", ["planning", "starting", "armed"])
def test_nothing_begins_whose_asker_was_killed(cell, moment):
    before = poses(cell)
    arguments = [cell.endpoint, *map(str, cell.files("pendant").values()), *cell.names]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, "", "", *arguments], stdout=subprocess.PIPE, text=True
    ) as asker:
        while not (line := asker.stdout.readline()).startswith(moment):
            assert asker.poll() is None
        asker.kill()
    until(lambda: are_at_rest(cell), f"motions are dropped after {line}, and the lease runs out")
    assert poses(cell) == pytest.approx(before, abs=1e-9)


def test_nothing_begins_whose_asker_was_killed_while_one_daemon_hung(cell):
    before, daemon = poses(cell), cell.processes["arm-2"].pid
    arguments = [cell.endpoint, *map(str, cell.files("pendant").values()), *cell.names]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, "", "", *arguments], stdout=subprocess.PIPE, text=True
    ) as asker:
        while not asker.stdout.readline().startswith("starting"):
            assert asker.poll() is None
        os.kill(daemon, signal.SIGSTOP)
        time.sleep(0.3)  # arm-1 is armed, and arm-2 has the request in its socket
        asker.kill()
    os.kill(daemon, signal.SIGCONT)
    until(lambda: are_at_rest(cell), "motions are dropped, and the lease runs out")
    assert poses(cell) == pytest.approx(before, abs=1e-9)


def test_nothing_begins_where_a_daemon_was_killed_before_the_start(cell, fleet):
    before = poses(cell)

    def tell(what):
        if what == "moving":  # all are armed
            cell.end("arm-2", signal.SIGKILL)

    motions = [FleetMotion(name, "", turn(0.5)) for name in cell.names]
    together = move_together(fleet, motions, start_in=3.0, tell=tell)
    assert "arm-2" in together.problem
    cell.start("arm-2")
    cell.await_ready("arm-2")
    until(lambda: are_at_rest(cell), "the motion is withdrawn")
    after = poses(cell)
    for name in filter(lambda name: name.startswith("arm-1"), before):
        assert after[name] == pytest.approx(before[name], abs=1e-9)


def test_a_daemon_that_is_killed_on_the_way_stops_the_others(cell, fleet):
    def tell(what):
        if what == "moving":
            threading.Timer(2.5, cell.end, ("arm-2", signal.SIGKILL)).start()

    motions = [FleetMotion(name, "", LONG) for name in cell.names]
    together = move_together(fleet, motions, start_in=1.0, tell=tell)
    stopped, lost = together.ended
    assert stopped.summary.outcome == pb.OUTCOME_STOPPED
    assert stopped.problem == "stopped because of arm-2"
    assert lost.summary is None
    assert lost.problem.startswith("lost the daemon during motion ")
    cell.start("arm-2")
    cell.await_ready("arm-2")
    until(lambda: are_at_rest(cell), "all are at rest")


def test_ctrl_c_stops_all_on_their_paths(cell, tmp_path):
    keyframes = [{"rotation_vector": [0, 0, 3.0]}]
    motion = {"keyframes": keyframes, "limits": {"velocity": 0.1}, "approach": True}
    plan = tmp_path / "plan.json"
    motions = [{"daemon": name, "motion": motion} for name in cell.names]
    plan.write_text(json.dumps({"motions": motions}))
    process = begin("fleet", "move", plan, *options_of(cell, "pendant"))
    while not process.stdout.readline().startswith("moving"):
        assert process.poll() is None
    until(lambda: not are_at_rest(cell), "they move")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20.0)
    assert (process.returncode, errors) == (130, "orientd: interrupted\n")
    until(lambda: are_at_rest(cell), "all are at rest")


def test_an_asker_that_hangs_stops_all_when_its_leases_run_out(cell):
    arguments = [cell.endpoint, *map(str, cell.files("pendant").values()), *cell.names]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED.replace("0.9]", "3.0]"), "", "", *arguments],
        stdout=subprocess.PIPE, text=True,
    ) as asker:  # fmt: skip
        try:
            while not asker.stdout.readline().startswith("armed"):
                assert asker.poll() is None
            asker.send_signal(signal.SIGSTOP)
            until(lambda: are_at_rest(cell), "the leases run out")
        finally:
            asker.kill()


def test_an_observer_stops_and_does_nothing_else(cell):
    with cell.fleet("watcher") as fleet:
        assert [one.problem for one in fleet.stop()] == ["", ""]
        with fleet.robot("arm-1") as robot, pytest.raises(AccessError, match="operator"):
            robot.move(turn(0.1))


def test_nobody_stops_in_the_name_of_another(cell):
    with cell.fleet("watcher") as fleet:
        fleet.caller = "pendant"
        assert all(one.problem for one in fleet.stop(timeout=0.3))


def test_a_certificate_without_a_role_reads_nothing(cell):
    with pytest.raises(DaemonError, match="no daemon of cell"):
        cell.fleet("unknown", wait_for=[], timeout=0.7)


def test_a_stranger_is_not_let_in(cell, monkeypatch):
    other = Authority(cell.folder / "other")
    other.issue("pendant")
    files = cell.files("pendant", "other") | {"ca": cell.files("pendant")["ca"]}
    with pytest.raises(DaemonError, match=r"cannot use the certificate .*local issuer"):
        connect_fleet(cell.endpoint, cell=CELL, timeout=0.7, **files)
    # Nor is a client that does not look at its own certificate.
    monkeypatch.setattr(client, "common_name", lambda *files: "pendant")
    with pytest.raises(DaemonError, match="not with this certificate"):
        connect_fleet(cell.endpoint, cell=CELL, timeout=0.7, **files)


def test_what_moves_goes_on_when_the_router_dies(cell, fleet):
    with fleet.robot("arm-1") as robot:
        move = robot.move(LONG)
        cell.end("router", signal.SIGKILL)
        try:
            with pytest.raises(TimeoutError):
                move.wait(1.0)
            robot.stop()
            assert move.wait(20.0, check=False).outcome == pb.OUTCOME_STOPPED
        finally:
            cell.start("router")
            cell.await_ready("router")
    with cell.fleet() as again:
        assert again.daemons == cell.names


def test_a_renewed_certificate_is_taken_up_by_a_reload(cell, fleet):
    cell.authority.revoke("arm-2")
    cell.authority.issue("arm-2", hosts="IP:127.0.0.1", use="member")
    gateway = gateway_of("arm-2")
    joined = cell.log(gateway).count("fleet: arm-2 is in cell")
    for name in ("arm-2", gateway):
        cell.processes[name].send_signal(signal.SIGHUP)
    # It may be away for less time than passes between two looks at the cell: the log tells.
    until(
        lambda: cell.log(gateway).count("fleet: arm-2 is in cell") > joined,
        "it leaves, and joins with the new one",
    )
    until(lambda: fleet.daemons == cell.names, "it comes back")


def test_a_reload_of_settings_that_are_not_valid_changes_nothing(cell, fleet):
    gateway, config = gateway_of("arm-2"), cell.folder / "arm-2.toml"
    before = config.read_text()
    config.write_text(before.replace("[fleet]", "[fleet]\nspeed = 3"))
    try:
        cell.processes[gateway].send_signal(signal.SIGHUP)
        line = f"fleet: reload: nothing changed: {config}: fleet.speed: unknown key"
        until(lambda: line in cell.log(gateway), "the log")
    finally:
        config.write_text(before)
    cell.processes[gateway].send_signal(signal.SIGHUP)
    until(lambda: "fleet: reload: nothing has changed" in cell.log(gateway), "the log")
    assert fleet.daemons == cell.names


def test_the_demo_starts_daemons_and_prints_the_skew():
    done = orientd_command("fleet", "demo", "--daemons", "2")
    assert "started within" in done.stdout
    assert done.stdout.count(": done") == 2
