"""A program that a driver feeds over a socket of its own, as ROS drivers control an arm."""

import socket
import struct
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

SCRIPT = (Path(__file__).parents[2] / "data/ur/external_control.script").read_text()


@contextmanager
def driven(robot):
    """The program, playing, and the driver's end of its socket."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        server.settimeout(5.0)
        text = SCRIPT.replace("HOST", "127.0.0.1").replace("PORT", str(port))
        with socket.create_connection((robot.host, 30002), timeout=5.0) as uploading:
            uploading.sendall(text.encode())
            link, _ = server.accept()
        with link:
            link.settimeout(5.0)
            yield link


def order(link, mode, values):
    link.sendall(struct.pack(">7i", mode, *(round(one * 1e6) for one in values)))
    time.sleep(0.004)


def test_driver_streams_setpoints_then_speeds(ur_robot):
    start = ur_robot.state()["target_q"]
    with driven(ur_robot) as link:
        for step in range(100):
            order(link, 1, [start[0] + 0.001 * step, *start[1:]])
        ur_robot.wait_until(lambda state: state["target_q"][0] > start[0] + 0.05)
        for _ in range(50):
            order(link, 2, [-0.2, 0, 0, 0, 0, 0])
        ur_robot.wait_until(lambda state: state["told"][-1] == "timed out")
        state = ur_robot.wait_until(lambda state: state["runtime_state"] == "STOPPED")
    assert state["log"] == []
    assert state["is_still"]


def test_driver_forwards_a_trajectory(ur_robot):
    start = ur_robot.state()["target_q"]
    with driven(ur_robot) as link:
        link.sendall(struct.pack(">7i", 3, 2, 0, 0, 0, 0, 0))
        for turn in (0.1, 0.2):
            goal = [start[0] + turn, *start[1:], 0.3]
            link.sendall(struct.pack(">7i", *(round(one * 1e6) for one in goal)))
        assert link.recv(4) == bytes(4)
        assert ur_robot.state()["target_q"][0] == pytest.approx(start[0] + 0.2, abs=1e-5)


def test_statements_on_lines_of_their_own_and_what_is_said_of_errors(ur_robot):
    with socket.create_connection((ur_robot.host, 30001), timeout=5.0) as link:
        link.sendall(b"set_digital_out(0, True)\n")
        ur_robot.wait_until(lambda state: state["digital_outputs"] == 1)
        link.sendall(b"movej([0.1, -1.57, 1.4, -1.4, -1.57, 0], a=3, v=3)\r\n")
        ur_robot.wait_until(lambda state: abs(state["target_q"][0] - 0.1) < 1e-9)
        link.sendall(b"go_home()\n")
        ur_robot.wait_until(lambda state: "name_not_found:go_home:" in str(state["log"]))
        heard = b""
        while b"compile_error_name_not_found:go_home:" not in heard:
            heard += link.recv(65536)
    assert b"PROGRAM_XXX_STARTED" in heard
