"""The world of the tests: one seed decides everything, and a killed process is gone."""

import gc
import hashlib
import os
import shutil
import signal

import grpc
import harness
import pytest
from command_line import begin
from harness import DaemonProcess, nudge, spin, until
from processes import World
from virtual_time import BEGIN_NS, Scheduler, other_process, virtual_time
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
            for pid in sorted(harness.children(daemon.process.pid) - {servo}):
                os.kill(pid, signal.SIGKILL)
            watching = begin("record", folder / "run.mcap", "--socket", daemon.socket)
            digests.append(watching.stdout.readline())
            stopping = begin("stop", "--json", "--socket", daemon.socket)
            stopped, _ = stopping.communicate(timeout=10.0)
            until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
            *_, last = daemon.move(nudge(-0.4))
            assert last.summary.outcome == pb.OUTCOME_DONE
            watching.send_signal(signal.SIGINT)
            watching.communicate(timeout=10.0)
            assert (stopping.returncode, watching.returncode) == (0, 0)
            os.kill(servo, signal.SIGKILL)
            until(lambda: daemon.device().state == pb.STATE_FAULT, "the fault")
            files = (daemon.recording, folder / "run.mcap")
            digests.extend(hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
        digests.append(stopped)

    run(world, live)
    return digests, world.scheduler.now_ns - BEGIN_NS


def run(world, work):
    """Run a function in a world to its end."""
    with running(world):
        task = world.scheduler.spawn(work, "test")
        while not task.is_over:
            assert world.scheduler.is_busy
            world.scheduler.run(world.scheduler.now_ns + 50_000_000)
    assert world.scheduler.problems == []


def test_a_seed_repeats_to_the_bit_and_two_differ(tmp_path):
    """The lives have one place, since commands print it, and one of them a process of its own."""
    life = tmp_path / "life"
    first = told("a", life)
    shutil.rmtree(life)
    other = told("b", life)
    shutil.rmtree(life)
    with other_process(told, "a", life, hashes=7, garbage=50) as process:
        again = process.stdout.read()
    assert again == f"{first}\n"
    assert first != other


def test_garbage_is_collected_at_instants_of_virtual_time_only():
    scheduler, collected_ns = Scheduler("a"), []

    class Cycle:
        def __init__(self):
            self.itself = self

        def __del__(self):
            collected_ns.append(scheduler.now_ns - BEGIN_NS)

    def live():
        for _ in range(5):
            for _ in range(10 * gc.get_threshold()[0]):
                Cycle()
            scheduler.sleep(5.0)

    with virtual_time(scheduler):
        scheduler.spawn(live, "live")
        scheduler.run(BEGIN_NS + 60 * 10**9)
    assert sorted(set(collected_ns)) == [10 * 10**9, 20 * 10**9, 60 * 10**9]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_planner_that_is_killed_or_stands_still_is_replaced(tmp_path, number):
    problems = []

    def live():
        daemon = DaemonProcess(tmp_path)
        daemon.config.write_text(f"{daemon.config.read_text()}[planner]\nplan_timeout = 1.0\n")
        with daemon:
            process = daemon.process.pid
            planners = harness.children(process) - {daemon.device().servo_pid}
            for pid in planners:
                os.kill(pid, number)
            for _ in range(1 + len(planners)):
                try:
                    daemon.stub.Plan(pb.PlanRequest(motion=nudge(0.1)))
                except grpc.RpcError as error:
                    problems.append(error.code())
            assert daemon.stub.Plan(pb.PlanRequest(motion=nudge(0.1))).plan.duration > 0.0
            assert not planners & {pid for pid in planners if harness.is_alive(pid)}

    run(World(Scheduler("a")), live)
    late = grpc.StatusCode.DEADLINE_EXCEEDED
    assert set(problems) == ({late} if number == signal.SIGSTOP else set())


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
