"""A stop before the command line is loaded: what is read of it, and what is left to that."""

import json
import os
import socket
import subprocess
import sys
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
    return asked is not None and urgent.run(asked)


def begin(arguments):
    """Send what a command line plainly asks for; return the connection, or -1."""
    asked = first_stop.plain(arguments)
    return -1 if asked is None else first_stop.begin(asked)


class Told(ControlServicer):
    """Devices that are told to stop, and note it."""

    def __init__(self):
        self.stops, self.halts = [], []

    def Stop(self, request, context):  # noqa: N802 - gRPC's name
        self.stops.append(request)
        return pb.StopResponse()

    def Halt(self, request, context):  # noqa: N802 - gRPC's name
        self.halts.append(request)
        return pb.HaltResponse()


@pytest.fixture
def there(tmp_path, monkeypatch):
    server = grpc.server(futures.ThreadPoolExecutor(1))
    told = Told()
    add_ControlServicer_to_server(told, server)
    server.add_insecure_port(f"unix:{tmp_path / 'socket'}")
    server.start()
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "socket"))
    yield told
    server.stop(None).wait()


def test_a_stop_is_sent_and_told(there, capsys):
    assert run(["stop", "--json"])
    (request,) = there.stops
    assert request.device == ""
    assert request.caller.startswith("orientd stop, process ")
    assert capsys.readouterr().out == '{"devices": []}\n'


def test_a_halt_of_one_device_is_sent(there):
    assert run(["halt", "-d", "leg"])
    (request,) = there.halts
    assert request.device == "leg"
    assert not there.stops


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
        ["stop", "--device", "x" * 200],
    ],
)
def test_whatever_else_is_left_to_the_command_line(there, arguments):
    assert not run(arguments)
    assert not there.stops


def test_a_daemon_that_is_reached_over_tcp_is_left_to_the_command_line(there, monkeypatch):
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
