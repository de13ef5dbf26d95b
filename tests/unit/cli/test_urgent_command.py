"""A stop before the command line is loaded: what is read of it, and what is left to that."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from concurrent import futures

import grpc
import pytest

from orientd import first_stop
from orientd.cli import urgent
from orientd.rpc import control_pb2 as pb
from orientd.rpc.control_pb2_grpc import ControlServicer, add_ControlServicer_to_server


def run(arguments):
    """Do what a command line plainly asks for; return whether that is done."""
    asked = first_stop.plain(arguments)
    return asked is not None and urgent.run(asked, first_stop.begin(asked))


def begin(arguments):
    """Send what a command line plainly asks for; return the connection, or -1."""
    asked = first_stop.plain(arguments)
    return -1 if asked is None else first_stop.begin(asked)


class Daemon(ControlServicer):
    """One device that was stopped."""

    def GetState(self, request, context):  # noqa: N802 - gRPC's name
        device = pb.DeviceReport(device=pb.Device(name=request.device or "arm"))
        device.state = pb.STATE_STOPPING
        return pb.GetStateResponse(devices=[device])


@pytest.fixture
def there(tmp_path):
    server = grpc.server(futures.ThreadPoolExecutor(1))
    add_ControlServicer_to_server(Daemon(), server)
    server.add_insecure_port(f"unix:{tmp_path / 'socket'}")
    server.start()
    yield
    server.stop(None).wait()


@pytest.fixture
def stops(listener):
    """Answer every stop, and return what was asked for."""
    asked = []

    ending = threading.Event()
    listener.settimeout(0.05)

    def answer():
        while not ending.is_set():
            with contextlib.suppress(TimeoutError):
                connection, _ = listener.accept()
                with connection, connection.makefile("rw") as both:
                    said = json.loads(both.readline())
                    if said["kind"] == "hello":
                        print('{"admitted": 0}', file=both, flush=True)
                        continue
                    asked.append(said)
                    device = {"name": said["device"] or "arm", "state": "STREAMING", "motion": 3}
                    print(json.dumps({"devices": [device]}), file=both, flush=True)

    thread = threading.Thread(target=answer)
    thread.start()
    yield asked
    ending.set()
    thread.join()


def test_a_stop_is_sent_and_how_the_device_is_then_is_told(there, stops, capsys):
    assert run(["stop", "--json"])
    assert stops == [{"kind": "stop", "device": ""}]
    (device,) = json.loads(capsys.readouterr().out)["devices"]
    assert (device["name"], device["state"]) == ("arm", "stopping")


def test_a_halt_of_one_device_is_sent(there, stops):
    assert run(["halt", "-d", "leg"])
    assert stops == [{"kind": "halt", "device": "leg"}]


def test_where_the_daemon_is_silent_what_was_stopped_is_told(stops, capfd):
    assert run(["stop", "--json"])
    assert json.loads(capfd.readouterr().out) == {
        "devices": [{"name": "arm", "state": "streaming", "motion": 3}],
        "daemon": "does not answer",
    }


def test_where_nobody_takes_stops_the_command_line_asks(there, tmp_path, monkeypatch):
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "socket"))
    assert not run(["stop"])


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["status"],
        ["stop", "--help"],
        ["stop", "now"],
        ["stop", "--device"],
        ["stop", "--device", "--json"],
        ["stop", "--device="],
        ["stop", "--address", "there:1"],
    ],
)
def test_whatever_else_is_left_to_the_command_line(stops, arguments):
    assert not run(arguments)
    assert not stops


def test_a_daemon_that_is_reached_over_tcp_is_left_to_the_command_line(stops, monkeypatch):
    monkeypatch.delenv("ORIENTD_SOCKET")
    monkeypatch.setenv("ORIENTD_ADDRESS", "there:1")
    assert not run(["stop"])


@pytest.fixture(autouse=True)
def priorities(monkeypatch):
    """Return what priorities are asked for, in place of these."""
    asked = []
    monkeypatch.setattr(os, "setpriority", lambda *arguments: asked.append(arguments))
    return asked


@pytest.fixture
def listener(tmp_path, monkeypatch):
    """Return what listens where stops are taken."""
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "socket"))
    with socket.socket(socket.AF_UNIX) as it:
        it.bind(str(tmp_path / "socket.stop"))
        it.listen(4)
        it.settimeout(5.0)
        yield it


def said_by(listener):
    """Return what somebody says, and hang up on them."""
    connection, _ = listener.accept()
    with connection, connection.makefile() as incoming:
        return json.loads(incoming.readline())


def test_what_the_command_line_plainly_says_is_sent_first(listener, priorities):
    for arguments, kind, device in (
        (["stop"], "stop", ""),
        (["halt", "--json", "-d", "left_arm-2"], "halt", "left_arm-2"),
    ):
        os.close(begin(arguments))
        assert said_by(listener) == {"kind": kind, "device": device}
        assert priorities.pop() == (os.PRIO_PROCESS, 0, -20)


@pytest.mark.parametrize(
    "arguments", [[], ["status"], ["stop", "now"], ["stop", "-d", 'a"b'], ["stop", "-d", "a b"]]
)
def test_nothing_else_is_sent_first(listener, arguments):
    assert begin(arguments) == -1


def test_nobody_is_told_first_where_nobody_listens_or_over_tcp(tmp_path, monkeypatch):
    assert begin(["stop", "--socket", str(tmp_path / "nowhere")]) == -1
    monkeypatch.setenv("ORIENTD_ADDRESS", "there:1")
    assert begin(["stop"]) == -1


def test_next_to_nothing_is_loaded_before_a_stop_is_sent():
    program = (
        "import sys\n"
        "before = set(sys.modules)\n"
        "from orientd.cli import start\n"
        "print(*sorted(set(sys.modules) - before))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    ours = {"__future__", "_socket", "orientd", "orientd.cli", "orientd.cli.start"}
    assert set(done.stdout.split()) == {*ours, "orientd.first_stop"}


def test_nothing_large_is_loaded_before_it_is_sent():
    program = (
        "import sys\n"
        "from orientd.cli import start, urgent\n"
        "large = {'typer', 'grpc', 'google', 'numpy', 'pydantic', 'rich', 'asyncio'}\n"
        "print(*large & {name.split('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("\n", "")


def test_a_client_that_does_not_plan_loads_nothing_that_plans():
    program = (
        "import sys, orientd.rpc.client, orientd.cli.texts\n"
        "large = {'numpy', 'scipy', 'pydantic', 'yaml'}\n"
        "print(*large & {name.split('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("\n", "")
