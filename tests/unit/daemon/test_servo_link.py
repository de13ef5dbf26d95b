"""What is between the daemon and a servo process: a real one, with the loopback driver."""

import contextlib
import os
import time

import pytest

from orientd.daemon.devices.servo_link import ServoLink
from orientd.errors import StateError
from orientd.servo.process import ProcessSettings
from orientd.stream import Command


@pytest.fixture
def link():
    settings = ProcessSettings(
        device="arm",
        driver="orientd_loopback:LoopbackDriver",
        options={},
        period_ns=2_000_000,
        phase_ns=0,
        path_capacity=4096,
        cycle_capacity=4096,
        heartbeat_timeout_ns=10**10,
        feedback_timeout_ns=10**9,
        stall_timeout_ns=10**10,
        priority=0,
        spin_ns=0,
        daemon_pid=os.getpid(),
        report_path="",
    )
    link = ServoLink(settings)
    yield link
    link.process.kill()
    link.process.wait()
    with contextlib.suppress(BufferError):
        link.close()


def test_answers_that_nobody_waits_for_are_not_kept(link):
    ends = time.monotonic() + 30.0
    while not link.memory.cycles.head and time.monotonic() < ends:
        time.sleep(0.01)
    for _ in range(20):
        link.stop()
    # Answered behind all of them, though there were more than there is room for.
    with pytest.raises(StateError, match="not possible while idle"):
        link.ask(Command.SPEED, speed=1.0)
    assert not link._answers
    assert not link._awaited
