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


def test_something_is_done_after_each_when_its_result_has_been_told():
    done = threading.Semaphore(0)
    planners = Planners(1, afterwards=done.release)
    assert planners.submit(lambda: 5).result(10) == 5
    assert done.acquire(timeout=10)
    with pytest.raises(ZeroDivisionError):
        planners.submit(lambda: 1 // 0).result(10)
    assert done.acquire(timeout=10)


def test_something_is_done_before_each_in_its_thread():
    seen = []
    planners = Planners(1, before=lambda: seen.append(threading.get_ident()))
    assert planners.submit(threading.get_ident).result(10) == seen[0]
    assert planners.submit(lambda: len(seen)).result(10) == 2


def test_what_fails_before_is_told_to_who_waits():
    with pytest.raises(ZeroDivisionError):
        Planners(1, before=lambda: 1 // 0).submit(lambda: 5).result(10)
