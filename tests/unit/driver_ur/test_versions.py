"""Features of a version of the robot's software, and the reported reason of a long silence."""

import os
import random

import pytest

from emulated_ur import Behaviour, Controller, dashboard
from orientd_ur import controller as said
from orientd_ur.timing import WriteSilence

CASES = int(os.environ.get("ORIENTD_CASES", "100"))


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ((3, 2, 0, 0), "PolyScope 3.2.0 is too old for the client library; 3.4 or newer is needed"),
        ((3, 4, 0, 0), ""),
        ((3, 15, 8, 106339), ""),
        ((5, 3, 9, 0), "PolyScope 5.3.9 is too old for the client library; 5.4 or newer"),
        ((5, 4, 0, 0), ""),
        ((10, 9, 0, 0), "PolyScope 10.9.0 is too old for the client library; 10.10 or newer"),
        ((10, 11, 0, 0), ""),
    ],
)
def test_version_that_is_too_old_is_said_with_the_one_that_is_needed(version, words):
    found = said.version_problem(version)
    assert found.startswith(words) if words else not found


def test_only_polyscope_x_has_no_dashboard():
    assert not said.has("a dashboard server", (10, 11, 0, 0))
    assert all(said.has("a dashboard server", one) for one in ((3, 4, 0, 0), (5, 4, 0, 0)))


def test_emulated_robot_of_any_version_has_what_the_driver_takes_it_to_have():
    generator = random.Random(11)
    for _ in range(CASES):
        major = generator.choice((3, 5, 10))
        version = (major, *(generator.randint(0, 16) for _ in range(2)), 0)
        if major < 10:
            robot = Controller(Behaviour(version=version))
            answer = dashboard.reply(robot, "is in remote control")
            is_known = said.has("is in remote control", version)
            assert (answer == "true") == is_known, version
            assert answer.startswith("could not understand") != is_known, version


def test_pause_beyond_the_watchdog_is_said_with_its_length():
    silence = WriteSilence(10.0)
    silence.begin(0)
    for k in range(1, 100):
        silence.note(2_000_000 * k)
    assert silence.reason(200_000_000) == ""
    silence.note(388_000_000)
    said = silence.reason(400_000_000)
    assert "nothing was written for 190 ms, 100 ms are allowed (`watchdog_hz`)" in said
    for k in range(200, 260):
        silence.note(2_000_000 * k)
    assert silence.reason(521_000_000) == ""
