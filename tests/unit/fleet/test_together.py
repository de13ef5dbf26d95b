"""Motions of several daemons that begin together or not at all."""

import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

from orientd.errors import DaemonError, LateError
from orientd.model.request import Keyframe, MotionRequest
from orientd.protocol import control_pb2 as pb
from orientd_fleet.together import FleetMotion, Together, _all_or_none, _wait

HOME = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0))])


class Handle:
    """An armed motion, whose daemon may not answer."""

    def __init__(self, problem=None):
        self.problem, self.calls = problem, []

    def cancel(self):
        self.calls.append("cancel")
        if self.problem is not None:
            raise self.problem

    def abandon(self):
        self.calls.append("abandon")


def begun(*results):
    futures = []
    for result in results:
        future = Future()
        failed = isinstance(result, Exception)
        future.set_exception(result) if failed else future.set_result(result)
        futures.append(future)
    names = ("left", "middle", "right")
    return [FleetMotion(name, "arm", HOME) for name in names], futures


def test_motions_are_withdrawn_with_an_answer_if_one_is_late():
    left, right = Handle(), Handle()
    with pytest.raises(LateError, match=r"middle.*: too late; nothing moves"):
        _all_or_none(*begun(left, LateError("too late"), right))
    assert left.calls == right.calls == ["cancel", "abandon"]


def test_a_daemon_that_does_not_answer_a_withdrawal_is_named():
    left, right = Handle(DaemonError("it did not answer in time")), Handle()
    reason = r"too late; left.* may still move: it did not answer in time"
    with pytest.raises(DaemonError, match=reason):
        _all_or_none(*begun(left, LateError("too late"), right))
    assert left.calls == right.calls == ["cancel", "abandon"]


class Moving:
    """A motion that ends when it is cancelled, or at once with an error."""

    plan = pb.Plan()

    def __init__(self, error=None):
        self.error, self.cancelled = error, threading.Event()

    def wait(self, *, check):
        assert not check
        if self.error is not None:
            raise self.error
        assert self.cancelled.wait(10.0)
        return pb.MoveSummary(outcome=pb.OUTCOME_STOPPED, text="stopped by ana")

    def cancel(self):
        self.cancelled.set()


def test_a_stopped_motion_names_the_one_whose_daemon_died():
    motions, _ = begun()
    with ThreadPoolExecutor(4) as pool:
        ended = _wait(motions[:2], [Moving(), Moving(DaemonError("lost the daemon"))], pool)
    assert Together(ended, None, None).problem == (
        "left/arm: stopped because of middle/arm; middle/arm: lost the daemon"
    )
