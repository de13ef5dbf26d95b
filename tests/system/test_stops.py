"""Stop is apart from everything: its own process, its own socket, the servos' own memory."""

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import assert_refused, orientd
from harness import DEVICE, DaemonProcess, children, spin, until

import orientd as package
from orientd.errors import UnknownNameError
from orientd.rpc import ask_to_stop, stop_socket
from orientd.rpc import control_pb2 as pb

STRANGER = 54304


@pytest.fixture(scope="module")
def daemon(open_folder):
    # Else the servo would stop by itself once its daemon does not answer.
    process = DaemonProcess(open_folder, lease=600.0, patience=30.0)
    process.config.write_text(f"[access]\nconnections = 8\n{process.config.read_text()}")
    with process:
        yield process


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
        assert (report.name, report.state.name) == (DEVICE, "STREAMING")
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


def test_callers_who_say_nothing_keep_nobody_from_stopping(daemon):
    moving(daemon)
    silent = []
    for _ in range(300):
        silent.append(socket.socket(socket.AF_UNIX))
        silent[-1].connect(str(stop_socket(daemon.socket)))
    assert ask_to_stop(daemon.socket, "stop")[0]["state"] == "STREAMING"
    for one in silent:
        one.close()
    ended(daemon)


def test_a_stop_says_what_it_met_and_knows_its_devices(daemon):
    assert ask_to_stop(daemon.socket, "stop", DEVICE)[0]["state"] == "HOLDING"
    with pytest.raises(UnknownNameError, match="expected one of arm, got 'leg'"):
        ask_to_stop(daemon.socket, "stop", "leg")
    assert_refused(orientd("halt", "-d", "leg", "--socket", daemon.socket), "got 'leg'")


@pytest.mark.parametrize(
    "said", [b"\n", b"{}\n", b"[]\n", b'{"kind": "go"}\n', b"\xff\n", b"x" * 5000, b""]
)
def test_nonsense_ends_in_a_word_or_in_silence(daemon, said):
    with socket.socket(socket.AF_UNIX) as caller:
        caller.settimeout(10.0)
        caller.connect(str(stop_socket(daemon.socket)))
        caller.sendall(said)
        caller.shutdown(socket.SHUT_WR)
        try:
            answer = caller.recv(1000)
        except ConnectionResetError:
            answer = b""
    assert answer in (b"", b'{"wrong": "expected a stop or a halt"}\n')
    assert ask_to_stop(daemon.socket, "stop")


def test_repeated_stops_are_written_down_once(daemon):
    path = daemon.folder / "state/orientd/audit.jsonl"
    before = path.stat().st_size
    for _ in range(300):
        ask_to_stop(daemon.socket, "stop")
    with path.open("rb") as log:
        log.seek(before)

        def counted():
            log.seek(before)
            return sum(json.loads(line).get("times", 0) for line in log) >= 300

        until(counted, "the stops in the audit log")
        log.seek(before)
        assert len(log.readlines()) < 60


def test_who_is_not_admitted_is_told_so(daemon):
    if os.getuid():
        pytest.skip("becomes another user, which root may")
    program = (
        # What a call imports may lie where the user to become cannot look.
        "import os; from pathlib import Path; from orientd.rpc import ask_to_stop\n"
        f"ask_to_stop(Path({str(daemon.socket)!r}), 'stop')\n"
        f"os.setgroups([]); os.setgid({STRANGER}); os.setuid({STRANGER})\n"
        f"ask_to_stop(Path({str(daemon.socket)!r}), 'stop')"
    )
    stop_socket(daemon.socket).chmod(0o666)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    stop_socket(daemon.socket).chmod(0o600)
    assert "refuses: user 54304 is not admitted" in done.stderr
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "does not admit user 54304" in done.stderr


def test_the_process_that_takes_stops_is_started_again(daemon):
    (pid,) = stops_of(daemon)
    os.kill(pid, signal.SIGKILL)
    until(lambda: stops_of(daemon) not in ([], [pid]), "another process")
    moving(daemon)
    until(lambda: ask_to_stop(daemon.socket, "stop") is not None, "a stop")
    ended(daemon)


def stops_of(daemon):
    """Return the numbers of the processes that take stops of a daemon."""
    return [
        pid
        for pid in children(daemon.process.pid)
        if b"orientd.daemon.stops" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
