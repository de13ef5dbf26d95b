"""Targets and commands reach a daemon of a cell by its name."""

import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import termios

import numpy as np
import pytest
from command_line import begin, environment
from fleet_cell import CELL, RunningCell
from harness import until

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import Quaternion

pytest.importorskip("zenoh")

AIM = Quaternion(w=float(np.cos(0.15)), x=0.0, y=0.0, z=float(np.sin(0.15)))


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    folder.chmod(0o700)
    with RunningCell(folder, 1) as cell:
        yield cell


@pytest.fixture
def fleet(cell):
    with cell.fleet() as fleet:
        yield fleet


def cycle(robot):
    (device,) = robot.state().devices.values()
    return device.cycle


def test_a_device_follows_targets_and_comes_to_rest_at_their_end(fleet):
    with fleet.robot("arm-1") as robot:
        with robot.track() as tracking:

            def is_there():
                tracking.aim(AIM)
                return tracking.report.HasField("error") and tracking.report.error < 1e-3

            until(is_there, "it is there")
        assert rotation.angle(to_quaternion(cycle(robot).q), [AIM.w, AIM.x, AIM.y, AIM.z]) < 1e-3
        assert cycle(robot).state == pb.STATE_HOLDING
        assert tracking.report.refused == 0


def test_a_device_plays_chunks_and_says_how_it_goes(fleet):
    with fleet.robot("arm-1") as robot:
        begin = rotation.multiply(to_quaternion(cycle(robot).q), np.array([1.0, 0.0, 0.0, 0.0]))
        turns = rotation.exp(np.outer(0.01 * np.arange(16), [0.0, 0.0, 1.0]))
        poses = Quaternion.from_array(rotation.multiply(begin, turns), order="wxyz")
        with robot.play() as play:
            for _ in range(3):
                play.chunk(poses, rate=30.0)
        timing = play.timing()
        assert (timing.chunks, timing.skipped, play.report.refused) == (3, 0, 0)
        end = rotation.multiply(begin, turns[-1])
        assert rotation.angle(to_quaternion(cycle(robot).q), end) < 1e-4


def test_whoever_follows_stops_when_the_caller_has_gone(cell, fleet):
    with cell.fleet() as other:
        tracking = other.robot("arm-1").track()
        tracking.aim(AIM)
    with fleet.robot("arm-1") as robot:
        until(lambda: cycle(robot).state == pb.STATE_HOLDING, "it holds")
        until(lambda: not robot.state().daemon.leases, "the lease runs out")


def test_the_table_on_a_terminal_is_written_over_and_fits(cell):
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 40, 0, 0))
    command = [sys.executable, "-m", "orientd", "fleet", "status"]
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    variables.pop("COLUMNS", None)  # the width is the terminal's
    with (
        os.fdopen(ours, "rb", buffering=0) as terminal,
        subprocess.Popen(command, stdout=theirs, stderr=theirs, env=variables) as process,
    ):
        os.close(theirs)
        shown = b""
        while shown.count(b"\x1b[2A") < 3:  # from below the two lines to the first one
            shown += terminal.read(4096)
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 130
    _, first, *_ = shown.decode().split("\x1b[2A\r")
    header, arm, end = first.split("\x1b[K\r\n")
    assert header.startswith("daemon  device  state")
    assert arm.startswith("arm-1   arm     holding")
    assert max(len(header), len(arm)) <= 40
    assert end == "\x1b[J"


def test_the_command_follows_at_the_address_of_a_fleet(cell):
    variables = environment(ORIENTD_FLEET=cell.endpoint, ORIENTD_CELL=CELL)
    targets = f"{json.dumps({'rotation_vector': [0, 0, 0.1], 'time_to_live': 5.0})}\n" * 20
    process = begin(
        "track", "--address", "fleet:arm-1", "--json", env=variables, stdin=subprocess.PIPE
    )
    output, errors = process.communicate(targets, timeout=30.0)
    assert (process.returncode, errors) == (0, "")
    assert json.loads(output)["targets"] == 20
