"""The daemon as a process: how it starts, what it leaves behind, how it ends."""

import contextlib
import json
import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import grpc
import numpy as np
import pytest
from command_line import COMMAND, assert_refused, environment, orientd
from grpclib.health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from harness import DEVICE, DaemonProcess, health, is_alive, resident_kib, spin, until
from motions import through

import orientd as package
from orientd import __version__, processor
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

SERVICE = "orientd.v1.Control"
MOST_KIB, MOST_OWN_KIB = 70 * 1024, 36 * 1024


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """A daemon at rest, which nobody has asked to plan."""
    with DaemonProcess(tmp_path_factory.mktemp("daemon")) as process:
        yield process


def log(daemon):
    return (daemon.folder / "log").read_text()


def test_it_serves_the_standard_health_check(daemon):
    for name in ("", SERVICE):
        answer = health(daemon.channel).Check(HealthCheckRequest(service=name))
        assert answer.status == HealthCheckResponse.SERVING


REFLECTED = """
import sys
import grpc
from grpc_reflection.v1alpha import proto_reflection_descriptor_database as reflection
with grpc.insecure_channel(sys.argv[1]) as channel:
    database = reflection.ProtoReflectionDescriptorDatabase(channel)
    print(*database.get_services())
    (service,) = database.FindFileContainingSymbol(sys.argv[2]).service
    print(*(method.name for method in service.method))
"""


@pytest.mark.real
def test_it_says_by_reflection_what_it_offers(daemon):
    # In a process of its own: its messages and those of the daemon's library exclude each other.
    command = [sys.executable, "-c", REFLECTED, f"unix:{daemon.socket}", SERVICE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    services, methods = (line.split() for line in done.stdout.splitlines())
    assert SERVICE in services
    offered = {"GetState", "WatchState", "Plan", "Move", "Track", "Stop", "Halt", "Reset"}
    assert offered <= set(methods)


@pytest.mark.real
def test_it_is_small_before_its_first_plan(daemon):
    pid = daemon.process.pid
    assert resident_kib(pid, "RssAnon") <= MOST_OWN_KIB
    # How much of libraries is mapped with what is used of them is up to the system's page cache.
    assert resident_kib(pid) <= MOST_KIB


@pytest.mark.real
def test_starting_imports_nothing_that_is_slow():
    code = (
        "import sys, orientd.cli.main\n"
        "slow = {'numpy', 'scipy', 'grpc', 'orientd.kernels', 'matplotlib', 'rich'}\n"
        "print(', '.join(slow & set(sys.modules)))\n"
        "import orientd.daemon.server\n"
        "print(', '.join(slow & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("\n\n", "")


def test_the_socket_is_for_its_user_alone(tmp_path):
    process = subprocess.Popen(
        [*COMMAND, "run"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd="/",
        env=environment(XDG_RUNTIME_DIR=str(tmp_path), XDG_CONFIG_HOME=str(tmp_path)),
    )
    path = tmp_path / "orientd" / "control.sock"
    simulated = "no configuration: a simulated device, no robot"
    assert process.stdout.readline() == f"ready at {path}: arm (loopback, 500 Hz); {simulated}\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    process.terminate()
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in errors
    assert list(path.parent.iterdir()) == []
    kernels = f"orientd {__version__} with kernels for {processor.level()}"
    assert errors.splitlines()[0].endswith(f" INFO daemon: {kernels}")


def test_a_second_daemon_is_refused_and_the_first_goes_on(daemon):
    done = orientd("run", "--config", daemon.config)
    assert_refused(
        done, f"a daemon listens at {daemon.socket} already (process {daemon.process.pid})"
    )
    assert daemon.device().state == pb.STATE_HOLDING


@pytest.mark.real
def test_no_process_of_a_daemon_is_in_reach_of_the_terminal(tmp_path):
    # One that is hit by Ctrl-C while it imports would end in a traceback.
    with DaemonProcess(tmp_path / "daemon") as daemon:
        process = daemon.process.pid
        tasks = Path(f"/proc/{process}/task").iterdir()
        children = [int(one) for task in tasks for one in (task / "children").read_text().split()]
        assert len(children) >= 2
        assert os.getpgid(process) not in [os.getpgid(child) for child in children]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_stops_the_motion_on_its_path_and_leaves_nothing(tmp_path, number):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        servo = daemon.device().servo_pid
        watch = health(daemon.channel).Watch(HealthCheckRequest(service=SERVICE))
        assert next(watch).status == HealthCheckResponse.SERVING
        stream = daemon.move(spin(20.0))
        until(lambda: daemon.device().path_time > 1.0, "a second of motion")
        daemon.process.send_signal(number)
        daemon.process.send_signal(number)
        assert next(watch).status == HealthCheckResponse.NOT_SERVING
        *_, last = stream
        assert last.summary.outcome == pb.OUTCOME_STOPPED
        assert last.summary.text == "the daemon is going down"
        assert daemon.end() == 0
        assert not is_alive(servo)
        assert not daemon.socket.exists()
        assert not daemon.socket.with_name("control.sock.lock").exists()
        sent = daemon.sent()
        daemon.assert_limits_kept()
        assert (sent[-1] == sent[-2]).all()
        assert "Traceback" not in log(daemon)


def test_a_servo_that_is_suspended_ends_in_order_with_its_daemon(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        daemon.move(spin(20.0))
        until(lambda: daemon.device().path_time > 1.0, "a second of motion")
        os.kill(daemon.device().servo_pid, signal.SIGSTOP)
        assert daemon.end() == 0
        report = json.loads(daemon.report.read_text())
        assert (report["reason"], report["state"]) == ("the daemon asked for it", "holding")
        daemon.assert_limits_kept()


@pytest.mark.real
def test_a_daemon_that_is_told_to_end_while_it_plans_ends(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        turns = np.cumsum(np.random.default_rng(1).normal(0.0, 0.05, (20_000, 3)), axis=0).tolist()
        plan = daemon.stub.Plan.future(pb.PlanRequest(motion=through(turns, approach=True)))
        # Others are served meanwhile, so the request has arrived once they were.
        for _ in range(50):
            daemon.device()
        assert not plan.done()
        daemon.process.terminate()
        with pytest.raises(grpc.RpcError) as caught:
            plan.result(timeout=20)
        assert caught.value.details() == "the daemon is going down"
        assert daemon.process.wait(30.0) == 0
        assert "Traceback" not in log(daemon)


def test_a_daemon_that_is_told_to_end_while_it_starts_ends(tmp_path):
    daemon = DaemonProcess(tmp_path / "daemon")
    process = subprocess.Popen(
        [*COMMAND, "run", "--config", str(daemon.config)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(XDG_STATE_HOME=str(tmp_path)),
    )
    until(lambda: process.poll() is not None or daemon.socket.exists(), "the socket")
    process.terminate()
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "Traceback" not in errors


def test_it_ends_with_its_input_where_it_is_told_to(tmp_path):
    daemon = DaemonProcess(tmp_path / "daemon")
    process = subprocess.Popen(
        [*COMMAND, "run", "--config", str(daemon.config), "--until-end-of-input"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(XDG_STATE_HOME=str(tmp_path)),
    )
    assert process.stdout.readline().startswith("ready")
    process.communicate(timeout=20)
    assert process.returncode == 0


def test_a_device_that_cannot_be_opened_is_told_and_the_daemon_serves(tmp_path):
    daemon = DaemonProcess(tmp_path / "daemon")
    text = daemon.config.read_text().replace(str(daemon.recording), str(tmp_path / "no" / "where"))
    daemon.config.write_text(text)
    with daemon:
        device = daemon.device()
        assert device.state == pb.STATE_FAULT
        assert "cannot record to" in device.fault_text
        assert "cannot record to" in log(daemon)
        with pytest.raises(grpc.RpcError) as caught:
            daemon.move(spin(2.0))
        assert caught.value.code() in (
            grpc.StatusCode.FAILED_PRECONDITION,
            grpc.StatusCode.UNAVAILABLE,
        )
        (tmp_path / "no").mkdir()
        daemon.renew()
        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))
        assert daemon.device().state == pb.STATE_HOLDING
        assert daemon.end() == 0


def test_a_path_that_no_socket_can_have_is_refused(tmp_path):
    done = orientd("run", "--socket", tmp_path / ("x" * 120))
    assert_refused(done, "the path of a socket has at most 107 bytes")


@pytest.mark.real
def test_a_log_that_nobody_reads_holds_nothing_up(tmp_path):
    fifo = tmp_path / "full"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDWR | os.O_NONBLOCK)
    try:
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(reader, bytes(4096))
        daemon = DaemonProcess(tmp_path / "daemon")
        daemon.prefix = ("bash", "-c", 'exec "$@" 2>"$0"', str(fifo))
        with daemon:
            *_, last = daemon.move(spin(1.0))
            assert last.summary.outcome == pb.OUTCOME_DONE
        assert daemon.process.returncode == 0
    finally:
        os.close(reader)


@pytest.fixture
def unanswered(tmp_path):
    """Return a daemon's settings of which one device cannot be opened, for want of a folder."""
    config = tmp_path / "orientd.toml"
    config.write_text(
        f'[devices.arm]\ndriver = "loopback"\noptions = {{ record = "{tmp_path}/there/sent" }}\n'
        '[devices.leg]\ndriver = "loopback"\n'
    )
    return config


def test_a_device_that_does_not_answer_is_named_and_tried_again(unanswered, tmp_path):
    run = [*COMMAND, "run", "--config", str(unanswered), "--socket", str(tmp_path / "s")]
    with subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as one:
        line = one.stdout.readline()
        assert line.startswith(f"not ready at {tmp_path}/s: device arm: cannot record")
        with package.connect(tmp_path / "s") as robot:
            robot.enable("leg")
            assert robot.state().devices["leg"].state == pb.STATE_HOLDING
            (tmp_path / "there").mkdir()
            assert one.stdout.readline().startswith(f"ready at {tmp_path}/s: arm")
            assert robot.state().devices["arm"].state == pb.STATE_HOLDING
        one.terminate()
    assert one.returncode == 0


@pytest.mark.real
def test_a_device_that_does_not_answer_ends_a_daemon_that_requires_it(unanswered, tmp_path):
    arguments = ("run", "--require-devices", "--config", unanswered, "--socket", tmp_path / "s")
    done = orientd(*arguments)
    assert (done.returncode, done.stdout) == (1, "")
    last = done.stderr.splitlines()[-1]
    assert last.startswith("orientd: device arm: cannot record")
