"""Planner processes: real ones, asked, given up, killed and replaced."""

import asyncio
import os
import signal
import time

import numpy as np
import pytest
from direct_planners import DirectPlanners
from motions import through

from orientd import config
from orientd.daemon.planners.messages import CHUNK, PlanRequest, Rank, record_at_rest
from orientd.daemon.planners.pool import MOST_WAITING, Planners
from orientd.driver import IDENTITY, ZERO
from orientd.errors import DaemonError, DeadlineError, PlanError, RequestError, TooMuchError
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.facts import MOTION_RECORD

SETTINGS = config.default_settings().devices["arm"]
HERE = record_at_rest(IDENTITY, ZERO, ())


def motion(*angles, **fields):
    return through([(0, 0, angle) for angle in (0.0, *angles)], **fields)


SMALL = motion(0.1)


ENDLESS = motion(*np.tile([0.1, 0.2], 50_000))


def job(content=SMALL, caller="", timeout=60.0):
    request = PlanRequest(content, caller=caller, timeout=timeout, unix_ns=0)
    return request.beginning("arm", HERE)


def endless(timeout, caller=""):
    return job(ENDLESS, caller, timeout)


def run(test, *, processes=1, timeout=60.0):
    """Run a coroutine function with planners, and end these."""

    async def main():
        planners = Planners(
            [SETTINGS],
            processes=processes,
            timeout=timeout,
        )
        planners.start()
        try:
            await planners.plan(job())
            while not planners._idle:
                await asyncio.sleep(0.01)
            return await test(planners)
        finally:
            await planners.close()

    return asyncio.run(main())


def pids(planners):
    return [process.pid for process in planners._planners.values()]


def test_a_planner_makes_what_is_made_here_bit_for_bit():
    one = job(motion(0.3, -0.2, 0.5))

    async def test(planners):
        found = await planners.plan(one)
        assert await asyncio.to_thread(found.await_event, lambda: False)
        return found, found.event

    there, event = run(test)
    here = asyncio.run(DirectPlanners([SETTINGS]).plan(one))
    assert (there.plan, event) == (here.plan, here.event)
    count = here.facts.record_count
    assert there.read(0, count) == here.read(0, count)


def test_what_is_wrong_with_a_request_is_raised_where_it_was_asked():
    async def test(planners):
        with pytest.raises(RequestError, match=r"^keyframes: expected at least 1") as refused:
            await planners.plan(job(b"keyframes: []"))
        assert refused.value.field == "keyframes"
        with pytest.raises(RequestError, match=r"^a motion must be a mapping"):
            await planners.plan(job(b"nonsense"))
        half = b'{"keyframes": [{"rotation_vector": [0, 0, 1]}], "method": "\\ud800"}'
        with pytest.raises(RequestError, match=r"^method: unknown method"):
            await planners.plan(job(half))

    run(test)


def test_a_killed_planner_fails_one_request_and_is_replaced():
    async def test(planners):
        (before,) = pids(planners)
        asked = asyncio.ensure_future(planners.plan(endless(60.0)))
        await asyncio.sleep(0.1)
        os.kill(before, signal.SIGKILL)
        with pytest.raises(DaemonError, match=f"planner process {before} ended while "):
            await asked
        assert (await planners.plan(job())).facts.record_count > 1
        assert pids(planners) != [before]

    run(test)


def test_a_plan_ends_at_its_deadline_and_says_what_took_so_long():
    async def test(planners):
        with pytest.raises(DeadlineError, match=r"^planning took longer than 0\.05 s: ") as late:
            await planners.plan(endless(0.05))
        assert isinstance(late.value, PlanError)
        assert (await planners.plan(job())).facts.record_count > 1

    run(test)


def test_a_planner_that_cannot_be_started_is_named(monkeypatch, tmp_path):
    async def main():
        planners = Planners([SETTINGS], processes=1, timeout=60.0)
        planners.start()
        try:
            await planners.plan(job(timeout=0.5))
        finally:
            await planners.close()

    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    problem = r"no planner can be started: .*No such file or directory"
    with pytest.raises(DeadlineError, match=problem):
        asyncio.run(main())


def test_a_planner_that_stands_still_is_killed():
    async def test(planners):
        (before,) = pids(planners)
        os.kill(before, signal.SIGSTOP)
        with pytest.raises(DeadlineError):
            await planners.plan(job(timeout=0.2))
        assert (await planners.plan(job())).facts.record_count > 1
        assert pids(planners) != [before]

    run(test)


def test_a_caller_that_goes_away_frees_its_planner():
    async def test(planners):
        before = pids(planners)
        asked = asyncio.ensure_future(planners.plan(endless(60.0)))
        await asyncio.sleep(0.1)
        asked.cancel()
        assert (await planners.plan(job())).facts.record_count > 1
        return before, pids(planners)

    before, after = run(test)
    assert len(after) == len(before)


def test_a_small_request_does_not_wait_behind_large_ones():
    order = []

    async def ask(planners, request, name):
        await planners.plan(request)
        order.append(name)

    async def test(planners):
        large = job(motion(*np.tile([0.1, 0.2], 600)))
        many = [asyncio.ensure_future(ask(planners, large, "large")) for _ in range(2)]
        await asyncio.sleep(0)
        await ask(planners, job(), "small")
        await asyncio.gather(*many)

    run(test)
    assert order.index("small") <= 1


def test_what_one_caller_may_have_waiting_is_bounded():
    async def test(planners):
        asked = [
            asyncio.ensure_future(planners.plan(job(caller="many")))
            for _ in range(MOST_WAITING + 5)
        ]
        ended = await asyncio.gather(*asked, return_exceptions=True)
        refused = [one for one in ended if isinstance(one, TooMuchError)]
        assert 1 <= len(refused) <= 5
        assert not [one for one in ended if isinstance(one, Exception) and one not in refused]

    run(test)


def test_a_moving_device_does_not_wait_for_a_large_plan():
    async def test(planners):
        while len(planners._planners) < 3:
            await asyncio.sleep(0.05)
        large = [
            asyncio.ensure_future(planners.plan(endless(60.0, str(caller)))) for caller in range(3)
        ]
        await asyncio.sleep(0.05)
        await planners.plan(job(), rank=Rank.URGENT)
        await planners.plan(job())
        assert not any(one.done() for one in large)
        for one in large:
            one.cancel()
        await asyncio.gather(*large, return_exceptions=True)

    run(test, processes=3)


def test_whoever_waits_is_told_when_the_daemon_ends():
    async def test(planners):
        asked = [asyncio.ensure_future(planners.plan(job())) for _ in range(3)]
        await asyncio.sleep(0)
        await planners.close()
        for one in asked:
            with pytest.raises(DaemonError, match="going down"):
                await one

    run(test)


def test_a_motion_of_several_chunks_is_fed_to_its_end_and_again():
    one = job(motion(0.5, duration=400.0))

    def fed(found):
        fed = found.feed(0, 4096)
        while (place := len(fed) // MOTION_RECORD.size) < found.facts.record_count:
            fed += found.feed(place, 4096)
        return fed

    found = asyncio.run(DirectPlanners([SETTINGS]).plan(one))
    assert found.facts.record_count > 2 * CHUNK
    first = fed(found)
    assert len(first) == (found.rest_record + 1) * MOTION_RECORD.size
    assert found.at_hand[0] > CHUNK  # what is far behind was forgotten
    assert fed(found.again()) == first


def test_a_slow_planner_may_take_longer_than_a_request_over_the_next_chunk():
    """There are records for a minute, and a planner after a killed one would be as slow."""
    one, timeout = job(motion(0.5, duration=200.0)), 0.3

    async def test(planners):
        (pid,) = pids(planners)
        found = await planners.plan(one)
        await found.arrive(CHUNK)
        os.kill(pid, signal.SIGSTOP)
        found.feed(CHUNK // 2 + 1, 512)  # asks for more
        await asyncio.sleep(3.0 * timeout)
        os.kill(pid, signal.SIGCONT)
        ends = time.monotonic() + 60.0
        while found.at_hand[1] == CHUNK and time.monotonic() < ends:
            await asyncio.sleep(0.01)
            found.feed(CHUNK // 2 + 1, 512)
        assert (found.at_hand[1], pids(planners)) == (found.facts.record_count, [pid])

    run(test, timeout=timeout)


def test_a_planner_warms_up_for_a_device_that_avoids_the_sun(monkeypatch):
    sun = {"name": "sun", "sun": {"latitude": 48.0, "longitude": 11.0}, "half_angle_deg": 1.0}
    devices = {"devices": {"arm": {"driver": "loopback", "keep_out": [sun]}}}
    made, whole = [], DevicePlanner.plan

    def plan(planner, *arguments, **options):
        made.append(whole(planner, *arguments, **options))
        return made[-1]

    monkeypatch.setattr(DevicePlanner, "plan", plan)
    DirectPlanners(config.parse(devices, source="test").devices.values()).worker.warm_up()
    assert len(made) == 1


def test_an_idle_planner_that_dies_is_replaced_before_anybody_asks():
    async def test(planners):
        (before,) = pids(planners)
        os.kill(before, signal.SIGKILL)
        while pids(planners) in ([before], []):
            await asyncio.sleep(0.01)
        assert (await planners.plan(job())).facts.record_count > 1

    run(test)


def test_the_planners_have_started_once_there_is_one_or_there_is_a_reason_why_not(
    monkeypatch, tmp_path
):
    async def main():
        planners = Planners([SETTINGS], processes=1, timeout=60.0)
        planners.start()
        try:
            return await planners.started(), pids(planners)
        finally:
            await planners.close()

    missing, started = asyncio.run(main())
    assert (missing, len(started)) == ("", 1)
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    missing, started = asyncio.run(main())
    assert missing.startswith("no planner can be started: ")
    assert not started
