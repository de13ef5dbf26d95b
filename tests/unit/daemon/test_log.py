"""Log lines without a reader do not block the daemon."""

import contextlib
import logging
import os

import pytest

from orientd.daemon.log import MOST_LINES, BackgroundHandler, _tell_lost, writer


@pytest.fixture
def pipe():
    ends = os.pipe()
    yield ends
    for end in ends:
        os.close(end)


def writing_to(descriptor):
    return BackgroundHandler(writer(descriptor), _tell_lost, most_waiting=MOST_LINES)


@pytest.fixture
def log(pipe):
    """A log to a pipe, with nothing else listening to it."""
    logger = logging.Logger("of a test")
    handler = writing_to(pipe[1])
    logger.addHandler(handler)
    yield logger
    handler.close()


def test_nobody_waits_for_a_reader_and_what_is_lost_is_counted(pipe, log, caplog):
    count = 5 * MOST_LINES
    for k in range(count):
        log.warning("%d %s", k, "x" * 200)
    (handler,) = log.handlers
    os.set_blocking(pipe[0], False)
    kept = b""
    while not caplog.messages:
        with contextlib.suppress(BlockingIOError):
            kept += os.read(pipe[0], 65536)
    (complaint,) = caplog.messages
    lost = int(complaint.removesuffix(" log lines are lost: nobody has read the ones before them"))
    assert kept.startswith(b"0 x")
    handler.close()
    with contextlib.suppress(BlockingIOError):
        while True:
            kept += os.read(pipe[0], 65536)
    assert len(kept.splitlines()) + lost == count


def test_the_end_does_not_wait_for_a_reader_who_never_comes(pipe):
    logger = logging.Logger("of a test")
    handler = writing_to(pipe[1])
    logger.addHandler(handler)
    for _ in range(MOST_LINES):
        logger.warning("x" * 1000)
    handler.close()
    assert not handler.queue.empty()
    # Its thread must not write to the number of the pipe once another file has it.
    found = b""
    while found.count(b"\n") < MOST_LINES:
        found += os.read(pipe[0], 65536)
