"""Processes that plan: the memory that a plan gives back, and the wait behind large plans."""

import time

import grpc
import pytest
from crowd import endless_motion, large_motion, raw_channel
from harness import nudge, until
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


@pytest.mark.storm
def test_many_large_plans_of_one_caller_do_not_hold_up_another(rig):
    large = pb.PlanRequest(device=DEVICE, **large_motion(50_000))
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
