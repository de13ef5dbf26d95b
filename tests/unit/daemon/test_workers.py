"""Threads that do work in order, and loops that survive what is unexpected."""

import logging
import threading

from orientd.daemon.workers import LoopErrors, Threads


def test_work_is_done_in_order_and_its_errors_reach_who_asked():
    threads, done = Threads(1, "test"), []
    first = threads.submit(done.append, 1)
    broken = threads.submit(lambda: 1 / 0)
    last = threads.submit(done.append, 2)
    last.result(10.0)
    assert first.done()
    assert isinstance(broken.exception(10.0), ZeroDivisionError)
    assert done == [1, 2]
    threads.close()


def test_work_that_hangs_keeps_only_its_own_threads():
    hanging, others, release = Threads(1, "a"), Threads(1, "b"), threading.Event()
    hung = hanging.submit(release.wait, 30.0)
    assert others.submit(lambda: "done").result(10.0) == "done"
    assert not hung.done()
    release.set()
    hung.result(10.0)


def test_a_loop_survives_what_is_unexpected_and_logs_the_first_of_it(caplog):
    errors = LoopErrors(logging.getLogger("test"), "nothing is counted")
    for _ in range(3):
        with errors.logged():
            raise ZeroDivisionError("oh")
    assert [one.getMessage() for one in caplog.records] == ["nothing is counted"]
