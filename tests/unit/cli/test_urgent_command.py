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
from orientd.protocol import control_pb2 as pb


def run(arguments):
    """Do what a command line plainly asks for; return whether that is done."""
    asked = first_stop.plain(arguments)
    return asked is not None and urgent.run(asked, first_stop.first(asked))


def stopping(request, context):
    """Report one device that was stopped."""
    device = pb.DeviceReport(name=request.device or "arm", state=pb.STATE_STOPPING)
    return pb.GetStateResponse(devices=[device])


@pytest.fixture
def there(tmp_path):
    server = grpc.server(futures.ThreadPoolExecutor(1))
    handler = grpc.unary_unary_rpc_method_handler(
        stopping, pb.GetStateRequest.FromString, pb.GetStateResponse.SerializeToString
    )
    calls = grpc.method_handlers_generic_handler("orientd.v1.Control", {"GetState": handler})
    server.add_generic_rpc_handlers([calls])
    server.add_insecure_port(f"unix:{tmp_path / 'socket'}")
    server.start()
    yield
    server.stop(None).wait()


@pytest.fixture
def stops(tmp_path, monkeypatch):
    """Answer every stop as the servo of an arm and that of a leg; return what was asked for."""
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "socket"))
    asked, ending = [], threading.Event()
    (tmp_path / "socket.stop").mkdir(mode=0o700)

    def answer(servo, name):
        while not ending.is_set():
            with contextlib.suppress(TimeoutError):
                word, sender = servo.recvfrom(100)
                asked.append((name, word.decode()))
                servo.sendto(b"took STREAMING 3", sender)

    with contextlib.ExitStack() as stack:
        for name in ("arm", "left_leg-2"):
            servo = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            servo.bind(str(tmp_path / "socket.stop" / name))
            servo.settimeout(0.05)
            thread = threading.Thread(target=answer, args=(servo, name))
            thread.start()
            stack.callback(thread.join)
        stack.callback(ending.set)
        yield asked


def test_a_stop_is_sent_and_how_the_device_is_then_is_told(there, stops, capsys):
    assert run(["stop", "--json"])
    assert sorted(stops) == [("arm", "stop"), ("left_leg-2", "stop")]
    (device,) = json.loads(capsys.readouterr().out)["devices"]
    assert (device["name"], device["state"]) == ("arm", "stopping")


def test_a_halt_of_one_device_is_sent_before_all_else(there, stops, priorities):
    assert run(["halt", "-d", "left_leg-2"])
    assert stops == [("left_leg-2", "halt")]
    assert priorities == [(os.PRIO_PROCESS, 0, -20)]


@contextlib.contextmanager
def servos(folder):
    """Listen as the servos of two devices; yield their sockets, in the order of the folder."""
    folder.mkdir(mode=0o700)
    with contextlib.ExitStack() as stack:
        listening = {}
        for name in ("arm", "leg"):
            listening[name] = servo = stack.enter_context(
                socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            )
            servo.bind(str(folder / name))
        yield {name: listening[name] for name in os.listdir(folder)}


def fill(path):
    """Leave no room for another datagram at *path*."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sending:
        sending.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                sending.sendto(b"hello", str(path))


def test_a_servo_that_reads_nothing_never_counts_as_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(first_stop, "TIMEOUT", 0.02)
    with servos(tmp_path / "socket.stop"):
        for _ in range(20):  # more than there is room for
            answers = first_stop.send(str(tmp_path / "socket"), "stop")
            assert answers == {"arm": ("", -1), "leg": ("", -1)}


def test_a_servo_without_room_delays_the_stop_of_no_other(tmp_path):
    folder = tmp_path / "socket.stop"
    with servos(folder) as listening:
        hung, other = listening.values()
        fill(folder / next(iter(listening)))

        def go_on():
            # The first servo goes on only once the second one has its stop.
            _, sender = other.recvfrom(100)
            other.sendto(b"took STREAMING 1", sender)
            while hung.recvfrom(100)[0] != b"stop":
                pass
            hung.sendto(b"took STREAMING 2", sender)

        going = threading.Thread(target=go_on)
        going.start()
        answers = first_stop.send(str(tmp_path / "socket"), "stop")
        going.join()
    assert {answer for answer, _ in answers.values()} == {"took STREAMING 1", "took STREAMING 2"}


def test_a_servo_that_has_ended_is_left_out(tmp_path):
    with servos(tmp_path / "socket.stop"):
        pass
    assert first_stop.send(str(tmp_path / "socket"), "stop") is None


def test_a_silent_servo_is_left_to_the_command_line(there, stops, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(first_stop, "TIMEOUT", 0.5)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as silent:
        silent.bind(str(tmp_path / "socket.stop" / "tail"))
        fill(tmp_path / "socket.stop" / "tail")
        assert not run(["stop"])
    assert capfd.readouterr().out == ""


def test_an_unknown_device_is_left_to_the_command_line(there, stops):
    assert not run(["stop", "-d", "tail"])
    assert not stops


def test_where_the_daemon_is_silent_what_was_stopped_is_told(stops, capfd):
    assert run(["stop", "--json"])
    assert json.loads(capfd.readouterr().out) == {
        "devices": [
            {"name": "arm", "state": "streaming", "motion": 3},
            {"name": "left_leg-2", "state": "streaming", "motion": 3},
        ],
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
    assert first_stop.plain(["stop"]) is None
    assert not run(["stop"])


@pytest.fixture(autouse=True)
def priorities(monkeypatch):
    """Return what priorities are asked for, in place of these."""
    asked = []
    monkeypatch.setattr(os, "setpriority", lambda *arguments: asked.append(arguments))
    return asked


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


@pytest.mark.parametrize(
    ("modules", "large"),
    [
        ("orientd.cli.start, orientd.cli.urgent", "click grpc google numpy pydantic rich asyncio"),
        ("orientd.client.robot, orientd.cli.texts", "numpy scipy pydantic yaml"),
    ],
    ids=["a stop", "a client that does not plan"],
)
def test_nothing_large_is_loaded_without_need(modules, large):
    program = (
        f"import sys, {modules}\n"
        f"print(*{set(large.split())} & {{name.split('.')[0] for name in sys.modules}})"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("\n", "")
