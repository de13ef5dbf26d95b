"""The world of the tests: one seed decides everything, and a killed process is gone."""

import hashlib
import os
import signal

import pytest
from harness import DaemonProcess, nudge, spin, until
from processes import World
from virtual_time import BEGIN_NS, Scheduler
from virtual_world import running

from orientd.protocol import control_pb2 as pb


def told(seed, folder):
    """Return what a short life of a daemon sends to its device, and how long it takes."""
    world, digests = World(Scheduler(seed)), []

    def live():
        with DaemonProcess(folder) as daemon:
            *_, last = daemon.move(nudge(0.4))
            assert last.summary.outcome == pb.OUTCOME_DONE
            daemon.move(spin(5.0))
            servo = daemon.device().servo_pid
            os.kill(servo, signal.SIGKILL)
            until(lambda: daemon.device().state == pb.STATE_FAULT, "the fault")
            digests.append(hashlib.sha256(daemon.recording.read_bytes()).hexdigest())

    with running(world):
        task = world.scheduler.spawn(live, "test")
        while not task.is_over:
            assert world.scheduler.is_busy
            world.scheduler.run(world.scheduler.now_ns + 50_000_000)
    assert world.scheduler.problems == []
    return digests, world.scheduler.now_ns - BEGIN_NS


def test_a_seed_repeats_to_the_bit_and_two_differ(tmp_path):
    first, again, other = (
        told(seed, tmp_path / name)
        for name, seed in (("first", "a"), ("again", "a"), ("other", "b"))
    )
    assert first == again
    assert first != other


def test_a_test_that_waits_for_ever_fails_with_the_place_where_it_waits():
    scheduler = Scheduler("a")

    def wait():
        with pytest.raises(AssertionError, match=r"(?s)nothing happens.*in wait"):
            scheduler.wait(None)

    task = scheduler.spawn(wait, "test")
    scheduler.run(scheduler.now_ns + 1)
    assert not scheduler.is_busy
    scheduler.fail(task, "nothing happens any more")
    assert (task.is_over, scheduler.problems) == (True, [])
