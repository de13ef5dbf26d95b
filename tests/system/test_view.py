"""`orientd view` and what is behind its pages, against a daemon in a process of its own."""

import contextlib
import os
import signal
import socket

import pytest
from browser import view_of
from command_line import assert_refused, begin, orientd
from harness import DEVICE, DaemonProcess, spin, until
from page import page_at

from orientd.client.robot import connect
from orientd.protocol import control_pb2 as pb

pytest.importorskip("websockets")

pytestmark = pytest.mark.world


@pytest.fixture(scope="module")
def view(daemon):
    with view_of(daemon.socket) as process:
        yield process


@pytest.fixture
def page(view):
    with page_at(view.address) as opened:
        opened.await_line("Holding")
        yield opened


@contextlib.contextmanager
def moving(daemon, seconds):
    """A motion that somebody else has begun."""
    daemon.token = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="ana")).lease.token
    stream = daemon.move(spin(seconds))
    yield daemon.started
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
    stream.cancel()
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")


def test_a_page_is_served_until_it_is_told_to_end(daemon):
    view = begin("view", "--no-open", "--port", 0, "--socket", daemon.socket)
    line = view.stdout.readline()
    assert line.startswith("ready at http://127.0.0.1:"), (line, view.stderr.read())
    with page_at(line.split()[-1]) as page:
        page.await_line("Holding")
    view.send_signal(signal.SIGTERM)
    rest, errors = view.communicate(timeout=15.0)
    assert (view.returncode, rest, errors) == (0, "", "")


def test_a_port_in_use_is_one_clear_line(daemon):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = orientd("view", "--no-open", "--port", port, "--socket", daemon.socket)
    assert_refused(done, f"port {port} is in use", "--port")


def test_cycles_reach_a_page_and_every_cycle_counts(page):
    first = page.until(lambda page: page.told.get("spans"), "cycles")[-1][0]
    page.until(lambda page: page.told["spans"][-1][0] > first + 20, "a second of cycles")
    assert page.told["pose"]["measured"] is not None
    assert page.told["device"]["name"] == DEVICE


def test_who_comes_later_sees_the_path_that_runs(daemon, view):
    with moving(daemon, 30.0), page_at(view.address) as page:
        path = page.until(lambda page: page.told.get("path"), "the path")
        assert len(path["q"]) > 100
        assert len(path["keyframes"]) > 1
        page.await_line("Moving")


@pytest.mark.parametrize("kind", ["stop", "halt"])
def test_a_page_stops_what_somebody_else_moves(daemon, page, kind):
    with moving(daemon, 60.0):
        page.await_line("Moving")
        page.await_line("held by ana")
        page.ask(kind)
        page.await_line("Holding")
        *_, last = daemon.stream
    assert last.summary.outcome == pb.OUTCOME_STOPPED
    assert f"(user:{os.getuid()})" in last.summary.text.partition("stopped by")[2]


def test_a_page_stops_a_motion_while_the_daemon_hangs(daemon, page):
    with moving(daemon, 60.0):
        until(lambda: daemon.device().path_time > 0.3, "motion")
        daemon.process.send_signal(signal.SIGSTOP)
        try:
            page.ask("stop")
            until(lambda: (daemon.sent()[-1] == daemon.sent()[-50:]).all(), "rest")
        finally:
            daemon.process.send_signal(signal.SIGCONT)
        # A servo that had missed the daemon would be in a fault.
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest, as the daemon says")


@pytest.mark.parametrize("kind", ["stop", "halt"])
def test_a_page_is_told_that_a_servo_does_not_answer_a_stop(daemon, page, kind):
    page.ask(kind)
    page.until(lambda page: {"answered": kind} in page.answers, "an answer to the stop")
    pid = daemon.device().servo_pid
    os.kill(pid, signal.SIGSTOP)
    try:
        page.ask(kind)
        page.await_refusal(f"no servo of arm answers the {kind}: it may still move")
        assert page.answers[-1]["answered"] == kind
    finally:
        os.kill(pid, signal.SIGCONT)
    page.await_line("Holding")


@contextlib.contextmanager
def moving_with_the_lease_of(page, daemon):
    """A motion of another program that shares the lease of a page, given back in the end."""
    page.ask("lease")
    page.await_line("held by this view")
    with contextlib.closing(connect(daemon.socket, holder="ana")) as robot:
        robot.acquire_lease(beside=True)
        robot.turn([0.0, 0.0, 0.2], 60.0)
        page.await_line("Moving")
        yield
    page.await_line("Holding")
    page.ask("lease")
    page.await_line("Lease free")


def test_pause_speed_and_resume_need_the_lease(daemon, page):
    page.ask("pause")
    page.await_refusal("take the lease first")
    with moving_with_the_lease_of(page, daemon):
        page.ask("speed", percent=50)
        page.await_line("at 50 % speed")
        page.ask("pause")
        page.await_line("Paused")
        page.ask("pause")
        page.await_line("Moving")
        page.ask("speed", percent=100)
        page.until(lambda page: page.told["control"]["speed"] == 100, "the speed on the page")
        page.ask("stop")
        page.await_line("Holding")


def test_buttons_can_be_pressed_if_the_state_allows_what_they_do(daemon, page):
    page.await_line("Lease free")
    assert (page.enabled, page.shown) == ({"lease"}, set())
    assert page.told["control"]["labels"]["lease"] == "Take the lease"
    with moving_with_the_lease_of(page, daemon):
        assert page.enabled == {"lease", "speed", "pause"}
        assert page.told["control"]["labels"]["lease"] == "Give the lease back"
        assert page.told["control"]["labels"]["pause"] == "Ⅱ Pause"
        page.ask("pause")
        page.await_line("Paused")
        assert page.told["control"]["labels"]["pause"] == "▶ Resume"
        page.ask("speed", percent=70)
        page.until(lambda page: page.told["control"]["speed"] == 70, "the speed on the page")
        page.ask("stop")
        page.await_line("Holding")
        assert page.enabled == {"lease", "speed"}
        page.ask("speed", percent=100)
        page.until(lambda page: page.told["control"]["speed"] == 100, "the speed on the page")


def test_the_lease_is_given_back_once_no_page_is_open(daemon, view):
    with page_at(view.address) as page:
        page.ask("lease")
        page.await_line("held by this view")
    until(lambda: not daemon.stub.GetState(pb.GetStateRequest()).daemon.leases, "no lease")


def test_a_daemon_that_dies_is_reported_and_found_again(tmp_path):
    with DaemonProcess(tmp_path / "it") as daemon, view_of(daemon.socket) as view:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with page_at(view.address) as page:
            page.await_line("Holding")
            daemon.process.kill()
            page.await_line("Not connected")
            assert page.says("no daemon answers")
            assert not page.says("ready to move")
            assert daemon.process.wait() == -signal.SIGKILL
            for stream in (daemon.process.stdout, daemon.log, daemon.channel):
                stream.close()
            daemon.start()
            page.until(lambda page: not page.says("Not connected"), "the return")
            page.await_line("Holding")


@pytest.mark.parametrize("options", [("--no-control",), ("--host", "0.0.0.0")])
def test_a_page_that_may_not_command_stops_and_does_nothing_else(daemon, options):
    with view_of(daemon.socket, *options) as view, page_at(view.address) as page:
        page.until(lambda page: "control" in page.told, "the page")
        assert page.told["control"] is None
        page.ask("lease")
        page.await_refusal("may stop and halt only")
        with moving(daemon, 60.0):
            page.await_line("Moving")
            page.ask("stop")
            page.await_line("Holding")


def test_a_page_for_other_machines_commands_if_it_is_allowed_to(daemon):
    options = ("--host", "0.0.0.0", "--control", "--dark")
    with view_of(daemon.socket, *options) as view, page_at(view.address) as page:
        page.await_line("Holding")
        assert page.told["dark"]
        page.ask("lease")
        page.await_line("held by this view")
        page.ask("lease")
