"""Emulated robots for the tests of the UR driver and of the emulator itself."""

import itertools
import os

import pytest
from harness import run_first

from emulated_ur import EmulatedRobot

_numbers = itertools.count(1)


@pytest.fixture
def ur_host():
    """An address of the loopback network that no other test uses, nor another run."""
    number, run = next(_numbers), os.getpid()
    return f"127.{1 + run // 200 % 250}.{1 + run % 200}.{1 + number % 250}"


@pytest.fixture
def ur_robot(ur_host):
    """An emulated robot that unlocks protective stops at once."""
    with EmulatedRobot(ur_host, "--unlock-after", "0.05") as robot:
        run_first(robot.process.pid)
        yield robot
