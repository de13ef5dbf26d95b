"""`orientd view` and what is behind its pages, against a daemon in a process of its own."""

import contextlib
import signal
import socket
import urllib.request

import numpy as np
import pytest
from command_line import assert_refused, begin, orientd
from harness import DEVICE, DaemonProcess, children, is_alive, spin, until

from orientd.errors import DaemonError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.client import connect
from orientd.rpc.reports import Outcome
from orientd.stream import ServoState
from orientd.viewer.proposal import Proposal
from orientd.viewer.stop_relay import StopRelay
from orientd.viewer.watcher import Watcher

pytest.importorskip("viser")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect as connect_page

TURN = (
    b"keyframes: [{rotation_vector: [0.1, 0, 0]}, {rotation_vector: [0, 0, 0.2]}]\napproach: true\n"
)


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon")) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@contextlib.contextmanager
def watching(daemon):
    watcher = Watcher(lambda: connect(daemon.socket, holder="view"))
    watcher.start()
    try:
        yield watcher
    finally:
        watcher.close()


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
    with urllib.request.urlopen(line.split()[-1]) as page:
        assert b"<html" in page.read()
    view.send_signal(signal.SIGTERM)
    rest, errors = view.communicate(timeout=15.0)
    assert (view.returncode, rest, errors) == (0, "", "")


def test_a_daemon_that_is_not_there_is_one_clear_line(tmp_path):
    done = orientd("view", "--no-open", "--socket", tmp_path / "none.sock")
    assert_refused(done, "no daemon answers", "none.sock")


def test_a_port_in_use_is_one_clear_line(daemon):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = orientd("view", "--no-open", "--port", port, "--socket", daemon.socket)
    assert_refused(done, f"port {port} is in use", "--port")


def has_tracking_error(watcher):
    return np.isfinite(watcher.strips.read()[1]["tracking_error"]).any()


def test_cycles_flow_only_while_somebody_looks(daemon):
    with watching(daemon) as watcher:
        assert watcher.sight.report.state is ServoState.HOLDING
        assert not watcher.is_streaming
        watcher.watch(True)
        until(lambda: watcher.is_streaming and has_tracking_error(watcher), "cycles")
        watcher.watch(False)
        until(lambda: not watcher.is_streaming, "silence")
        assert watcher.sight.cell.daemon.pid == daemon.process.pid


def test_who_comes_later_sees_the_plan_that_runs(daemon):
    with moving(daemon, 30.0) as started, watching(daemon) as watcher:
        watcher.watch(True)
        plan = until(lambda: watcher.sight.plan, "the plan")
        assert plan.motion_id == started.plan.motion_id
        assert plan.samples.times[-1] == pytest.approx(plan.duration)
        until(lambda: watcher.sight.report.state is ServoState.STREAMING, "the motion")
        before = watcher.sight.cycle.index
        until(lambda: watcher.sight.cycle.index > before + 100, "cycles")


def test_a_daemon_that_dies_is_reported_and_found_again(tmp_path):
    with DaemonProcess(tmp_path / "it") as daemon, watching(daemon) as watcher:
        watcher.watch(True)
        until(lambda: watcher.sight.cycle is not None, "cycles")
        daemon.process.kill()
        until(lambda: "no daemon answers" in watcher.sight.problem, "the loss")
        with pytest.raises(DaemonError, match="no daemon answers"):
            watcher.robot()
        assert watcher.sight.report.name == DEVICE
        assert daemon.process.wait() == -signal.SIGKILL
        for stream in (daemon.process.stdout, daemon.log, daemon.channel):
            stream.close()
        daemon.start()
        until(lambda: not watcher.sight.problem, "the return")
        assert watcher.sight.cell.daemon.pid == daemon.process.pid
        until(lambda: watcher.is_streaming, "cycles again")


def test_a_motion_is_planned_before_it_is_sent(daemon):
    with connect(daemon.socket, holder="view") as robot:
        proposal = Proposal()
        proposal.read("turn.yaml", TURN, robot, DEVICE, 500.0)
        assert "Not sent yet" in proposal.html
        assert "A stop takes" in proposal.html
        assert proposal.plan.samples is not None
        assert robot.state().devices[DEVICE].state is ServoState.HOLDING
        proposal.send(robot, DEVICE)
        assert proposal.plan is None
        until(lambda: proposal.look() or "was run to its end" in proposal.html, "the end")
        assert robot.planned().motion_id == robot.state().devices[DEVICE].motion_id


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "turn.yaml: the file is empty"),
        (b"\xff\xfe", "turn.yaml: not UTF-8 text"),
        (b"keyframes: []\nmethd: x\n", "unknown key"),
        (TURN + b"limits: {velocity: 100}\n", "limits.velocity"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_and_nothing_can_be_sent(daemon, content, said):
    with connect(daemon.socket, holder="view") as robot:
        proposal = Proposal()
        proposal.read("turn.yaml", TURN, robot, DEVICE, 500.0)
        proposal.read("turn.yaml", content, robot, DEVICE, 500.0)
        assert "Refused" in proposal.html
        assert said in proposal.html
        assert proposal.plan is None
        proposal.send(robot, DEVICE)
        assert robot.state().devices[DEVICE].state is ServoState.HOLDING


def test_a_proposal_that_the_device_has_moved_away_from_is_refused(daemon):
    with connect(daemon.socket, holder="view") as robot:
        proposal = Proposal()
        proposal.read("turn.yaml", TURN, robot, DEVICE, 500.0)
        assert robot.move([{"rotation_vector": [0.0, 0.3, 0.0]}]).wait().outcome is Outcome.DONE
        with pytest.raises(Exception, match="plan it again"):
            proposal.send(robot, DEVICE)
        assert proposal.plan is not None


PAGES = 8080


@pytest.fixture
def relay(daemon):
    process = StopRelay("127.0.0.1", PAGES, daemon.socket, {})
    yield process
    process.close()


def page_at(relay, origin):
    """A page's connection, once the process listens."""
    return connect_page(f"ws://127.0.0.1:{relay.port}", origin=origin, open_timeout=30.0)


@pytest.mark.parametrize("kind", ["stop", "halt"])
def test_a_page_has_devices_stopped_by_a_process_of_its_own(daemon, relay, kind):
    with moving(daemon, 60.0), page_at(relay, f"http://127.0.0.1:{PAGES}") as page:
        page.send(kind)
        assert page.recv(timeout=10.0) == "done"
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")


def test_a_page_is_told_of_a_stop_that_was_not_done(daemon, relay, tmp_path):
    elsewhere = StopRelay("127.0.0.1", PAGES, tmp_path / "none.sock", {})
    try:
        with page_at(elsewhere, f"http://127.0.0.1:{PAGES}") as page:
            page.send("stop")
            assert page.recv(timeout=10.0) == ""
    finally:
        elsewhere.close()


@pytest.mark.parametrize(
    "origin",
    ["https://elsewhere.example", f"http://elsewhere.example:{PAGES}", "http://127.0.0.1:9090"],
)
def test_a_page_from_elsewhere_stops_nothing(relay, origin):
    with pytest.raises(InvalidStatus, match="403"), page_at(relay, origin):
        pass


def test_a_view_that_is_killed_leaves_no_process(daemon):
    view = begin("view", "--no-open", "--port", 0, "--socket", daemon.socket)
    assert view.stdout.readline().startswith("ready")
    (child,) = children(view.pid)
    view.kill()
    view.communicate()
    until(lambda: not is_alive(child), "the end of what takes its stops")
