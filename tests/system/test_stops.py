"""Stop is apart from everything: each servo hears of it at a socket of its own."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections import Counter
from pathlib import Path

import grpc
import numpy as np
import pytest
from command_line import assert_refused, orientd
from harness import DEVICE, DaemonProcess, planned_path, spin, until
from motions import through

import orientd as package
from orientd import rotation
from orientd.client.stop_call import ask_to_stop
from orientd.errors import DaemonError, StateError
from orientd.first_stop import stop_folder
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import word

pytestmark = pytest.mark.world

STRANGER = 54304


@pytest.fixture(scope="module")
def daemon(open_folder):
    # Else the servo would stop by itself once its daemon does not answer.
    process = DaemonProcess(open_folder, lease=600.0, patience=30.0)
    process.config.write_text(f"[access]\nconnections = 8\n{process.config.read_text()}")
    with process:
        yield process


def stop_socket(daemon):
    return Path(stop_folder(str(daemon.socket)), DEVICE)


def moving(daemon):
    daemon.move(spin(60.0))
    until(lambda: daemon.device().path_time > 0.1, "motion")


def ended(daemon):
    """Wait for the end of the motion, and return why it was stopped."""
    *_, last = daemon.stream
    assert last.summary.outcome == pb.OUTCOME_STOPPED
    return last.summary.text


def kinds():
    return pytest.mark.parametrize("kind", ["stop", "halt"])


@kinds()
def test_a_stop_at_the_socket_keeps_to_the_path_and_a_halt_need_not(tmp_path, kind):
    around = 2.0 * np.pi * np.arange(13) / 12
    circle = [(0.4 * np.sin(a), 0.4 - 0.4 * np.cos(a), 0.0) for a in around]
    request = through(circle, approach=True)
    with DaemonProcess(tmp_path) as daemon:
        daemon.move(request)
        until(lambda: daemon.device().path_time > 0.5, "a quick circle")
        ask_to_stop(daemon.socket, kind)
        ended(daemon)
        daemon.assert_limits_kept()
        motion = planned_path(daemon, request)
        path = motion.sample(np.arange(0.0, motion.duration, daemon.period / 20.0)).q
        away = [rotation.angle(path, q).min() for q in daemon.sent()]
    # A setpoint on the path lies at most half way between two of these points.
    between = 2.5 * daemon.period / 20.0 / 2.0
    assert (max(away) <= 1.01 * between) == (kind == "stop")


@kinds()
def test_a_daemon_that_hangs_is_no_reason_that_a_stop_fails(daemon, kind):
    moving(daemon)
    daemon.process.send_signal(signal.SIGSTOP)
    try:
        done = orientd(kind, "--socket", daemon.socket)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout == "arm: told to stop while streaming\nthe daemon does not answer\n"
        (met,) = ask_to_stop(daemon.socket, kind)
        assert met["state"] in ("STOPPING", "HOLDING")
    finally:
        daemon.process.send_signal(signal.SIGCONT)
    assert f"(user:{os.getuid()})" in ended(daemon).partition("stopped by")[2]


def test_a_client_stops_while_its_daemon_hangs(daemon):
    with package.connect(daemon.socket) as robot:
        moving(daemon)
        daemon.process.send_signal(signal.SIGSTOP)
        try:
            (report,) = robot.stop()
        finally:
            daemon.process.send_signal(signal.SIGCONT)
        assert (report.name, word(report, "state")) == (DEVICE, "streaming")
        ended(daemon)


def test_a_daemon_that_takes_no_more_connections_is_stopped(daemon):
    moving(daemon)
    idle = []
    for _ in range(40):
        idle.append(socket.socket(socket.AF_UNIX))
        idle[-1].connect(str(daemon.socket))
    done = orientd("stop", "--json", "--socket", daemon.socket)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["devices"][0]["name"] == DEVICE
    for one in idle:
        one.close()
    ended(daemon)


@pytest.mark.real
def test_a_flood_of_nonsense_keeps_nobody_from_stopping(daemon):
    moving(daemon)
    program = (
        "import socket, sys\n"
        "one = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\n"
        "one.connect(sys.argv[1]); print('ready', flush=True)\n"
        "while True: one.send(b'nonsense')"
    )
    command = [sys.executable, "-c", program, str(stop_socket(daemon))]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as flood:
        flood.stdout.readline()
        try:
            assert ask_to_stop(daemon.socket, "stop")[0]["state"] == "STREAMING"
        finally:
            flood.kill()
    ended(daemon)


def test_a_stop_says_what_it_met_and_knows_its_devices(daemon):
    assert ask_to_stop(daemon.socket, "stop", DEVICE)[0]["state"] == "HOLDING"
    assert ask_to_stop(daemon.socket, "stop", "leg") is None
    assert_refused(orientd("halt", "-d", "leg", "--socket", daemon.socket), "got 'leg'")


def test_every_stop_is_written_down(daemon):
    path = daemon.folder / "state/orientd/audit.jsonl"

    def written():
        found = Counter()
        for line in path.read_text().splitlines() if path.exists() else ():
            record = json.loads(line)
            found[record.get("kind")] += record.get("times", 0)
        return found

    before, asked = written(), Counter(stop=200, halt=100)
    for kind in asked.elements():
        ask_to_stop(daemon.socket, kind)
    until(lambda: written() - before == asked, "each stop in the audit log, with its kind")


@pytest.mark.real
def test_who_is_not_admitted_is_told_so(daemon):
    if os.getuid():
        pytest.skip("becomes another user, which root may")
    program = (
        # What a call imports may lie where the user to become cannot look.
        "import os; from pathlib import Path; from orientd.client.stop_call import ask_to_stop\n"
        f"ask_to_stop(Path({str(daemon.socket)!r}), 'stop')\n"
        f"os.setgroups([]); os.setgid({STRANGER}); os.setuid({STRANGER})\n"
        f"ask_to_stop(Path({str(daemon.socket)!r}), 'stop')"
    )
    stop_socket(daemon).parent.chmod(0o755)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    stop_socket(daemon).parent.chmod(0o700)
    assert "refuses: user 54304 is not admitted" in done.stderr
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "does not admit user 54304" in done.stderr


def test_a_servo_that_is_started_again_hears_of_stops(daemon):
    os.kill(daemon.device().servo_pid, signal.SIGKILL)
    until(lambda: daemon.device().fault == pb.FAULT_SERVO_DIED, "the end of the servo")
    assert ask_to_stop(daemon.socket, "stop") is None
    daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))
    moving(daemon)
    assert ask_to_stop(daemon.socket, "stop")[0]["state"] == "STREAMING"
    ended(daemon)


@pytest.fixture
def pair(tmp_path):
    """Return a daemon with two devices; the servo of the arm reads nothing and has no room left."""
    with DaemonProcess(tmp_path / "pair", lease=600.0, patience=60.0, others=("leg",)) as process:
        pid = process.device().servo_pid
        os.kill(pid, signal.SIGSTOP)
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sending:
            sending.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while True:
                    sending.sendto(b"stop", str(stop_socket(process)))
        yield process
        os.kill(pid, signal.SIGCONT)


SILENT = "no servo of arm answers the stop: it may still move"


@pytest.mark.parametrize("kind", ["stop", "halt"])
def test_nobody_takes_silence_for_a_stop(pair, kind):
    done = orientd(kind, "--socket", pair.socket)
    assert_refused(done, SILENT.replace("stop", kind), "told to stop: leg")
    lines = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    assert lines.keys() == {"arm", "leg"}
    assert lines["arm"].startswith("unknown: no cycle for ")
    assert lines["leg"] == "holding"
    with package.connect(pair.socket) as robot, pytest.raises(DaemonError) as refused:
        getattr(robot, kind)()
    assert SILENT.replace("stop", kind) in str(refused.value)
    call = pair.stub.Stop if kind == "stop" else pair.stub.Halt
    with pytest.raises(grpc.RpcError) as failed:
        call(pb.StopRequest(caller="test"))
    assert failed.value.code() is grpc.StatusCode.UNAVAILABLE
    assert SILENT.replace("stop", kind) in failed.value.details()
    assert "told to stop: leg" in failed.value.details()


def test_a_folder_of_the_user_in_the_place_of_the_stop_sockets_is_left_alone(tmp_path):
    thesis = tmp_path / "robot.stop" / "thesis.txt"
    thesis.parent.mkdir()
    thesis.write_text("precious")
    done = orientd("run", "--socket", tmp_path / "robot")
    assert_refused(done, f"{thesis.parent} holds 'thesis.txt'", "choose another socket")
    assert thesis.read_text() == "precious"


def test_a_client_that_stops_while_it_prepares_a_motion_does_not_begin_it(daemon):
    with package.connect(daemon.socket) as robot:

        def keyframes():
            yield {"rotation_vector": [0.0, 0.0, 0.0]}
            robot.stop()
            yield {"rotation_vector": [0.0, 0.0, 0.5]}

        number = daemon.device().motion_number
        with pytest.raises(StateError, match="before the motion was asked for"):
            robot.move(keyframes(), approach=True)
        assert daemon.device().motion_number == number
