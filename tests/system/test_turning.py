"""Turning until it is stopped, in a real daemon: one motion takes over from the other."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from harness import DaemonProcess, until

import orientd
from orientd.client import endless_turn
from orientd.errors import LimitError, LimitKind
from orientd.protocol import control_pb2 as pb
from orientd.rotation import conjugate, log, multiply

pytestmark = pytest.mark.world

RATE = 1.0


def test_an_endless_turn_goes_on_at_its_rate_until_it_is_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(endless_turn, "SECONDS", 2.0)
    with DaemonProcess(tmp_path) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            turn = robot.turn_endlessly([0.0, 0.0, RATE])
            numbers = set()
            reader = threading.Thread(target=lambda: [*turn])
            reader.start()
            until(
                lambda: numbers.add(daemon.device().motion_number) or len(numbers) > 3,
                "motions that take over",
            )
            turn.cancel()
            summary = turn.wait(20.0)
            reader.join(20.0)
            assert not reader.is_alive()
        assert (summary.outcome, turn.problem) == (pb.OUTCOME_STOPPED, "")
        daemon.assert_limits_kept()
        q = daemon.sent()
        turned = log(multiply(conjugate(q[:-1]), q[1:])) / daemon.period
        # Never quicker where another takes over, and no other way.
        assert np.max(np.abs(turned[:, :2])) < 1e-9
        assert np.min(turned[:, 2]) > -1e-9
        assert np.max(turned[:, 2]) < RATE + 1e-9


class Bounded:
    """A robot of which an axis has room for one motion."""

    def __init__(self, handle):
        self._handles = [handle]

    def turn(self, *_, **__):
        if not self._handles:
            raise LimitError("angle of yaw", 5.0, 4.7, 3.0, "rad", kind=LimitKind.RANGE)
        return self._handles.pop()


class Handle:
    """A motion that is past its half, and done at the next look."""

    plan, speed, is_done = None, 1.0, False

    def __init__(self):
        self.progress = type("Progress", (), {"path_time": 2.0, "duration": 3.0})

    def wait(self, timeout=None, *, check=True):
        assert check
        self.is_done = True
        return "came to rest"


def test_a_turn_that_cannot_go_on_comes_to_rest_and_says_why():
    turn = endless_turn.EndlessTurn(Bounded(Handle()), [0.0, 0.0, RATE])
    assert turn.wait(20.0) == "came to rest"
    assert "angle of yaw reaches 5" in turn.problem


class Room:
    """A robot with an axis that has room for a turn of some seconds."""

    def __init__(self, seconds):
        self.now, self.room = 0.0, seconds

    def turn(self, _, seconds, **__):
        left = self.room - self.now
        if seconds > left:
            raise LimitError("angle of yaw", 5.0, 4.7, left, "rad", kind=LimitKind.RANGE)
        return Turning(self, seconds)


class Turning:
    """A motion that lasts as long as its robot's time has not passed."""

    plan, speed = None, 1.0

    def __init__(self, robot, seconds):
        self._robot, self._begun, self._seconds = robot, robot.now, seconds

    @property
    def progress(self):
        return SimpleNamespace(path_time=self._robot.now - self._begun, duration=self._seconds)

    @property
    def is_done(self):
        return self._robot.now >= self._begun + self._seconds

    def wait(self, timeout=None, *, check=True):
        assert check
        if not self.is_done:
            self._robot.now += timeout
        return "came to rest"


def test_a_turn_goes_on_until_an_axis_is_near_the_end_of_its_range():
    robot = Room(14.0)
    turn = endless_turn.EndlessTurn(robot, [0.0, 0.0, RATE])
    assert turn.wait(20.0) == "came to rest"
    assert 13.0 < robot.now < 14.0 + 0.2
    assert "angle of yaw reaches 5" in turn.problem
