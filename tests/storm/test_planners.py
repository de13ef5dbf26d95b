"""Processes that plan: what a call hears when one is killed, stopped, too slow, or left alone."""

import contextlib
import os
import signal
import threading
import time

import grpc
import pytest
from crowd import endless_motion, large_motion, raw_channel
from harness import nudge, spin, until
from storm_rig import Rig, await_idle, memory_mib

from orientd.protocol import control_pb2 as pb
from orientd.protocol.stub import control_stub

DEVICE = "arm"
PLAN_TIMEOUT = 2.0
NO_DEADLINE = 300.0
"""Time for which a planner is busy if it is neither freed nor replaced, s."""
PROMPT = 30.0
"""s; far less than that, and long enough for a busy machine."""

SMALL = pb.PlanRequest(device=DEVICE, motion=nudge(0.3))


@pytest.fixture(scope="module")
def endless():
    return pb.PlanRequest(device=DEVICE, motion=endless_motion())


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A daemon that gives plans all the time they want, and has planned before."""
    folder = tmp_path_factory.mktemp("rig")
    with Rig(folder, devices=[DEVICE], planner=f"plan_timeout = {NO_DEADLINE!r}") as it:
        it.stub.Plan(SMALL)
        yield it


@pytest.fixture(scope="module")
def hasty_rig(tmp_path_factory):
    """A daemon that gives plans little time."""
    folder = tmp_path_factory.mktemp("hasty")
    with Rig(folder, devices=[DEVICE], planner=f"plan_timeout = {PLAN_TIMEOUT!r}") as it:
        it.stub.Plan(SMALL)
        yield it


@contextlib.contextmanager
def under_way(rig, endless, timeout=NO_DEADLINE):
    """Have a plan under way that does not end; give its call and the process that plans."""
    call = rig.stub.Plan.future(endless, timeout=timeout)
    try:
        yield call, rig.busiest_planner()
    finally:
        call.cancel()


@contextlib.contextmanager
def small_plans(rig):
    """Have small plans made all the while, each of which must succeed."""
    ending, failures = threading.Event(), []

    def work():
        while not ending.wait(0.05):
            try:
                rig.stub.Plan(SMALL, timeout=30.0)
            except grpc.RpcError as error:
                failures.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()
    assert not failures


@contextlib.contextmanager
def motion(rig, seconds):
    """Have a motion run all the while, which must come to its end."""
    token = rig.stub.AcquireLease(pb.AcquireLeaseRequest(holder="test")).lease.token
    request = pb.MoveRequest(lease_token=token, device=DEVICE, motion=spin(seconds))
    stream = rig.stub.Move(request)
    try:
        next(stream)
        yield
        *_, last = stream
    finally:
        stream.cancel()
        rig.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=token))
    assert last.summary.outcome == pb.OUTCOME_DONE, last


def assert_replaced(rig, pid, count, seconds):
    """Wait until another process is in the place of *pid*, of *count* that plan."""
    until(
        lambda: pid not in (found := rig.planners()) and len(found) == count,
        "another planner in its place",
        seconds,
    )


def test_a_killed_planner_fails_its_own_call_alone_and_is_replaced(rig, endless):
    rig.await_sleep()
    count = len(rig.planners())
    with under_way(rig, endless) as (call, pid), motion(rig, 4.0), small_plans(rig):
        os.kill(pid, signal.SIGKILL)
        until(call.done, "an answer", PROMPT)
        text = call.details()
        assert text
        assert "\n" not in text
        assert "Traceback" not in text
        assert_replaced(rig, pid, count, PROMPT)
    rig.stub.Plan(SMALL, timeout=PROMPT)


@pytest.mark.parametrize("whose", ["the configuration", "the caller"])
@pytest.mark.parametrize("is_stopped", [True, False])
def test_a_plan_ends_at_its_deadline_and_leaves_a_planner(request, endless, whose, is_stopped):
    name, timeout = ("rig", PLAN_TIMEOUT) if whose == "the caller" else ("hasty_rig", None)
    rig = request.getfixturevalue(name)
    rig.await_sleep()
    count = len(rig.planners())
    begun = time.monotonic()
    with under_way(rig, endless, timeout) as (call, pid):
        if is_stopped:
            os.kill(pid, signal.SIGSTOP)
        try:
            until(call.done, "the deadline", begun + PLAN_TIMEOUT + PROMPT - time.monotonic())
            assert time.monotonic() - begun > 0.9 * PLAN_TIMEOUT
            assert call.code() is grpc.StatusCode.DEADLINE_EXCEEDED, call.details()
            if is_stopped:
                assert_replaced(rig, pid, count, PROMPT)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)
    await_idle(rig, PROMPT)
    rig.stub.Plan(SMALL, timeout=PROMPT)


def test_what_a_plan_took_is_given_back_when_it_ends_at_its_deadline(hasty_rig, endless):
    await_idle(hasty_rig, PROMPT)

    def sizes():
        return [memory_mib(pid, "VmRSS") for pid in (hasty_rig.pid, *hasty_rig.planners())]

    before = sizes()
    assert len(before) > 1, "the daemon has no planner process"
    for _ in range(3):
        with pytest.raises(grpc.RpcError):
            hasty_rig.stub.Plan(endless, timeout=30.0)
    allowed = max(before) + 32.0
    until(lambda: max(sizes()) < allowed, f"memory given back, {before} before", PROMPT)


def test_a_caller_who_hangs_up_frees_who_plans(rig, endless):
    await_idle(rig, PROMPT)
    calls = [rig.stub.Plan.future(endless) for _ in range(8)]
    time.sleep(1.0)
    for call in calls:
        call.cancel()
    rig.stub.Plan(SMALL, timeout=PROMPT)
    await_idle(rig, PROMPT)


@pytest.mark.storm
def test_many_large_plans_of_one_caller_do_not_hold_up_another(rig):
    large = pb.PlanRequest(device=DEVICE, motion=large_motion(50_000))
    await_idle(rig, PROMPT)
    begun = time.monotonic()
    rig.stub.Plan(large)
    alone = time.monotonic() - begun
    # The processors are shared while they plan.
    longest, waits = 2.0 * alone + 1.0, []
    with raw_channel(rig.socket) as greedy, raw_channel(rig.socket) as modest:
        calls = [control_stub(greedy).Plan.future(large) for _ in range(50)]
        time.sleep(0.5)
        for _ in range(5):
            begun = time.monotonic()
            control_stub(modest).Plan(SMALL, timeout=longest)
            waits.append(time.monotonic() - begun)
        done = sum(call.done() for call in calls)
        for call in calls:
            call.cancel()
    told = " ".join(f"{wait:.2f}" for wait in waits)
    print(f"\na large plan alone {alone:.2f} s; small ones behind 50: {told} s")
    assert done < 50, "they were planned before anybody could wait"
