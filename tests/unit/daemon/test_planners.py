"""Threads to plan in."""

import threading

import pytest

from orientd.daemon.planners import Planners
from orientd.errors import PlanError


def test_work_is_done_and_its_result_told():
    assert Planners(1).submit(lambda: 5).result(10) == 5


def test_what_goes_wrong_is_raised_where_the_result_is_asked_for():
    def work():
        raise PlanError("no way")

    with pytest.raises(PlanError, match="no way"):
        Planners(1).submit(work).result(10)


def test_only_so_many_work_at_a_time():
    planners, release, running = Planners(2), threading.Event(), threading.Semaphore(0)
    counts = []

    def work():
        running.release()
        release.wait(10)
        counts.append(threading.active_count())

    futures = [planners.submit(work) for _ in range(4)]
    assert running.acquire(timeout=10)
    assert running.acquire(timeout=10)
    assert not running.acquire(blocking=False)
    release.set()
    for future in futures:
        future.result(10)
    assert len(counts) == 4


def test_cancelled_work_is_never_begun():
    planners, release = Planners(1), threading.Event()
    began = threading.Event()

    def first():
        began.set()
        release.wait(10)

    busy = planners.submit(first)
    assert began.wait(10)
    waiting = planners.submit(lambda: pytest.fail("it was cancelled"))
    assert waiting.cancel()
    release.set()
    busy.result(10)
    assert planners.submit(lambda: "next").result(10) == "next"


def test_no_thread_keeps_the_process_from_ending():
    names = []
    Planners(1).submit(lambda: names.append(threading.current_thread().daemon)).result(10)
    assert names == [True]
