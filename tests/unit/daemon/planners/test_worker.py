"""A planner process from within: what may happen while it answers."""

import os
import signal
import socket

import pytest

from orientd.daemon.planners import worker
from orientd.daemon.planners.jobs import Failure, Methods, Question, frame
from orientd.errors import PlanError


class Refusing:
    """Work that cannot be done."""

    def __init__(self):
        self.done = 0

    def do(self, *_):
        self.done += 1
        raise PlanError("there is no way")

    def rest(self, *_):
        return None


@pytest.fixture
def peers():
    handler = signal.getsignal(signal.SIGUSR1)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs
    signal.signal(signal.SIGUSR1, handler)


def test_a_planner_that_is_given_up_while_it_says_why_goes_on(peers, monkeypatch):
    ours, theirs = peers
    of, asked = Failure.of, []

    def given_up(error):
        if not asked:
            asked.append(error)
            os.kill(os.getpid(), signal.SIGUSR1)
        return of(error)

    monkeypatch.setattr(Failure, "of", given_up)
    for _ in range(2):
        ours.sendall(frame(Question(Methods())))
    ours.shutdown(socket.SHUT_WR)
    work = Refusing()
    worker._serve(theirs, work)
    theirs.shutdown(socket.SHUT_WR)
    with ours.makefile("rb") as answers:
        told = answers.read()
    assert work.done == 2
    assert b"nobody waits for it any more" in told
    assert told.count(b"there is no way") == 1
