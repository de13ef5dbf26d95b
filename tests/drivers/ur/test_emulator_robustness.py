"""The emulated controller survives whatever its clients and its control channel do."""

import contextlib
import random
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from harness import is_alive
from ur_rig import until

from emulated_ur import LaunchError

VERSION_2 = struct.pack(">HBH", 5, ord("V"), 2)
ACCEPTED = struct.pack(">HBB", 4, ord("V"), 1)


def answer_to_version_2(client):
    client.sendall(VERSION_2)
    return client.recv(100)


def test_dropping_busy_connections_again_and_again_leaves_it_alive(ur_robot):
    generator = random.Random(1)
    for _ in range(40):
        clients = [socket.create_connection((ur_robot.host, 30004), 2.0) for _ in range(3)]
        for client in clients:
            client.sendall(VERSION_2 * generator.randrange(1, 50))
        ur_robot.ask("drop rtde")
        for client in clients:
            with contextlib.suppress(OSError):
                client.sendall(VERSION_2)
            client.close()
    ur_robot.wait_until(lambda s: s["rtde_clients"] == 0)
    with socket.create_connection((ur_robot.host, 30004), 2.0) as client:
        assert answer_to_version_2(client) == ACCEPTED


def test_more_clients_than_fit_are_hung_up_on_and_the_others_served(ur_robot):
    with contextlib.ExitStack() as stack:

        def answer():
            client = socket.create_connection((ur_robot.host, 30004), 30.0)
            with contextlib.suppress(ConnectionError):
                return answer_to_version_2(stack.enter_context(client))
            return b""

        first = stack.enter_context(socket.create_connection((ur_robot.host, 30004), 30.0))
        answers = [answer() for _ in range(70)]
        assert answers[:60] == [ACCEPTED] * 60
        assert answers[-1] == b""
        assert answer_to_version_2(first) == ACCEPTED


def test_bytes_that_are_no_package_end_only_their_own_connection(ur_robot):
    with (
        socket.create_connection((ur_robot.host, 30004), 2.0) as good,
        socket.create_connection((ur_robot.host, 30004), 2.0) as bad,
    ):
        bad.sendall(b"\xff\xff" * 100)
        ur_robot.wait_until(lambda s: s["rtde_clients"] == 1)
        assert answer_to_version_2(good) == ACCEPTED


def test_unknown_fault_is_answered_with_those_that_are_known(ur_robot):

    with pytest.raises(LaunchError, match=r"known: .*freeze"):
        ur_robot.ask("explode")


def test_emulator_ends_with_whoever_started_it(ur_host):
    code = (
        "import os, signal\n"
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from emulated_ur import EmulatedRobot\n"
        f"robot = EmulatedRobot({ur_host!r})\n"
        "robot.start()\n"
        "print(robot.process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    pid = int(subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE).stdout)
    assert until(lambda: not is_alive(pid), "the emulator's end")
