"""`orientd serve`: the promises of every adapter, tried with one or two of them."""

import signal
import socket
import time

import pytest
from command_line import assert_refused, begin, orientd
from harness import DEVICE

from orientd.client.robot import connect
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world


def test_a_daemon_that_is_not_there_is_one_clear_line(tmp_path):
    done = orientd("serve", "rotctld", "--port", 0, "--socket", tmp_path / "none.sock")
    assert_refused(done, "none.sock")


def test_a_device_that_is_not_there_is_one_clear_line(daemon):
    done = orientd("serve", "rotctld", "--port", 0, "--socket", daemon.socket, "-d", "leg")
    assert_refused(done, f"expected one of {DEVICE}, got 'leg'")


SERVERS = {"rotctld": (), "alpaca": ("--discovery", 0)}


@pytest.mark.parametrize("protocol", SERVERS)
def test_a_port_in_use_is_one_clear_line(daemon, protocol):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        at = ("--port", taken.getsockname()[1], "--socket", daemon.socket)
        done = orientd("serve", protocol, *SERVERS[protocol], *at)
    assert_refused(done, f"port {at[1]} is in use", "--port")


@pytest.mark.parametrize("protocol", SERVERS)
def test_an_address_of_another_machine_is_one_clear_line(daemon, protocol):
    at = ("--host", "192.0.2.1", "--port", 0, "--socket", daemon.socket)
    done = orientd("serve", protocol, *SERVERS[protocol], *at)
    assert_refused(done, "cannot serve at 192.0.2.1", "--host")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_its_end_brings_the_device_to_rest_in_one_line(daemon, number):
    server = begin("serve", "rotctld", "--port", 0, "--socket", daemon.socket)
    line = server.stdout.readline()
    assert line.startswith("ready at 127.0.0.1:"), (line, server.stderr.read())
    port = int(line.split()[2].rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(b"P 170 20\n")
        assert client.recv(100) == b"RPRT 0\n"
        server.send_signal(number)
        rest, errors = server.communicate(timeout=30.0)
    assert (server.returncode, rest, errors) == (0, f"{DEVICE} is at rest\n", "")
    with connect(daemon.socket) as robot:
        assert robot.state().devices[DEVICE].state == pb.STATE_HOLDING


@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.05, 0.2])
def test_a_second_interrupt_does_not_disturb_its_end(daemon, seconds):
    server = begin("serve", "rotctld", "--port", 0, "--socket", daemon.socket)
    port = int(server.stdout.readline().split()[2].rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as client:
        client.sendall(b"P 10 20\n")
        assert client.recv(100) == b"RPRT 0\n"
        server.send_signal(signal.SIGINT)
        time.sleep(seconds)
        server.send_signal(signal.SIGINT)
        rest, errors = server.communicate(timeout=30.0)
    assert (server.returncode, rest, errors) == (0, f"{DEVICE} is at rest\n", "")
