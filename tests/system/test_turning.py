"""Turning until it is stopped, in a real daemon: one motion takes over from the other."""

import threading

import numpy as np
from harness import DaemonProcess, until

import orientd
from orientd.client import endless_turn
from orientd.errors import LimitError, LimitKind
from orientd.protocol import control_pb2 as pb
from orientd.rotation import conjugate, log, multiply

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

    def wait(self, timeout=None):
        self.is_done = True
        return "came to rest"


def test_a_turn_that_cannot_go_on_comes_to_rest_and_says_why():
    turn = endless_turn.EndlessTurn(Bounded(Handle()), [0.0, 0.0, RATE])
    assert turn.wait(20.0) == "came to rest"
    assert "angle of yaw reaches 5" in turn.problem
