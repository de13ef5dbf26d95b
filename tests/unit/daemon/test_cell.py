"""The cell: who may command which device, and what becomes of the motions."""

import asyncio
import threading

import pytest
from direct_planners import DirectPlanners, order_of
from fake_device import FakeDevice

from orientd import config
from orientd.clock import ManualClock
from orientd.daemon.calls.requests import moving
from orientd.daemon.cell import Cell
from orientd.daemon.motions.options import AT_ONCE, MoveOptions
from orientd.daemon.motions.plan_store import KEPT_PLANS
from orientd.daemon.planners import PlanCall
from orientd.errors import (
    DaemonError,
    Fault,
    LeaseError,
    LimitError,
    PlanError,
    RequestError,
    StartError,
    StateError,
    UnknownNameError,
)
from orientd.planner import Keyframe, MotionRequest, State
from orientd.rotation import exp
from orientd.rpc.reports import Outcome
from orientd.stream import ServoState

SECOND = 1_000_000_000
MOTION = MotionRequest([Keyframe(tuple(exp([0.0, 0.0, angle]))) for angle in (0.0, 0.1)])
SETTINGS = {
    "daemon": {"lease_seconds": 5.0},
    "devices": {"arm": {"driver": "loopback"}, "leg": {"driver": "loopback"}},
}


@pytest.fixture
def clock():
    return ManualClock(1)


@pytest.fixture(scope="module")
def planners():
    return DirectPlanners(config.parse(SETTINGS, source="test").devices.values())


@pytest.fixture
def cell(clock, planners):
    settings = config.parse(SETTINGS, source="test")
    return Cell(settings, make_device=FakeDevice, planners=planners, clock=clock)


@pytest.fixture
def arm(cell):
    return cell.device("arm")


def plan(cell, device, request=MOTION):
    return asyncio.run(cell.plan(device, order_of(request)))


def start(cell, token, device, motion, *, stops=0):
    return asyncio.run(cell.starter.start(token, device, motion, stops=stops))


def move(cell, token, device, move_options=AT_ONCE):
    return asyncio.run(
        cell.starter.move(token, device, order_of(MOTION), move_options, stops=0, received_ns=0)
    )


def begin(cell, device, token):
    stops = cell.runs.stops(device)
    return start(cell, token, device, plan(cell, device), stops=stops)


def test_a_motion_runs_to_its_end(cell, arm):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    assert not run.ended.done()
    arm.finish()
    assert run.ended.result(0) == (Outcome.DONE, "")


def test_a_motion_that_ends_before_its_start_returns_has_ended(cell, arm):
    arm.during_start = arm.finish
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    assert run.ended.result(0) == (Outcome.DONE, "")


def test_a_motion_needs_the_lease(cell, arm):
    motion = plan(cell, arm)
    with pytest.raises(LeaseError, match="needs the lease"):
        start(cell, "", arm, motion, stops=0)
    cell.leases.acquire("ana")
    with pytest.raises(LeaseError, match="held by 'ana'"):
        start(cell, "nonsense", arm, motion, stops=0)
    assert "start 1" not in arm.calls


def test_a_motion_of_an_expired_lease_is_stopped(cell, arm, clock):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    cell.leases.expire()
    assert not run.ended.done()
    clock.advance(5 * SECOND)
    cell.leases.expire()
    assert run.ended.result(0) == (Outcome.STOPPED, "the lease of 'ana' has expired")


def test_a_motion_of_a_released_lease_is_stopped(cell, arm):
    lease = cell.leases.acquire("ana")
    run = begin(cell, arm, lease.token)
    cell.leases.release(lease.token)
    assert run.ended.result(0) == (Outcome.STOPPED, "the lease of 'ana' was released")


def test_only_motions_of_that_lease_are_stopped_with_it(cell, arm):
    lease = cell.leases.acquire("ana")
    begin(cell, arm, lease.token)
    arm.finish()
    cell.leases.release(lease.token)
    assert "stop" not in arm.calls


def test_whoever_takes_an_expired_lease_finds_its_motion_stopped(cell, arm, clock):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    clock.advance(5 * SECOND)
    cell.leases.acquire("ben")
    assert run.ended.result(0)[0] is Outcome.STOPPED


def test_anybody_may_stop_and_is_named(cell, arm):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    cell.stop("arm", "ben")
    assert run.ended.result(0) == (Outcome.STOPPED, "stopped by ben")


def test_an_empty_name_stops_every_device(cell, arm):
    cell.stop("", "ben")
    assert "stop" in arm.calls
    assert "stop" in cell.device("leg").calls


def test_one_dead_servo_does_not_keep_the_others_from_stopping(cell, arm):
    arm.is_dead = True
    with pytest.raises(DaemonError, match="did not answer stop"):
        cell.stop("", "ben")
    assert "stop" in cell.device("leg").calls


def test_a_stop_while_a_motion_is_planned_keeps_it_from_beginning(cell, arm):
    token = cell.leases.acquire("ana").token
    stops = cell.runs.stops(arm)
    motion = plan(cell, arm)
    cell.stop("arm", "ben")
    with pytest.raises(StateError, match="stopped before it began: stopped by ben"):
        start(cell, token, arm, motion, stops=stops)
    assert "start 1" not in arm.calls


def test_a_stop_beside_the_daemon_keeps_what_is_planned_from_beginning(cell, arm):
    token = cell.leases.acquire("ana").token
    stops = cell.runs.stops(arm)
    motion = plan(cell, arm)
    arm.stops_beside += 1
    cell.runs.note_stop(["arm"], "stopped by ben")
    with pytest.raises(StateError, match="stopped before it began: stopped by ben"):
        start(cell, token, arm, motion, stops=stops)
    start(cell, token, arm, motion, stops=cell.runs.stops(arm))


def test_a_stop_while_a_motion_is_started_stops_it(cell, arm):
    # The stop finds the device still at rest.
    arm.during_start = lambda: cell.runs.halt([cell.device("arm")], "stopped by ben")
    real_stop, arm.stop = arm.stop, lambda: None
    arm.during_start = lambda: (
        cell.runs.halt([arm], "stopped by ben"),
        setattr(arm, "stop", real_stop),
    )
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    assert run.ended.result(0) == (Outcome.STOPPED, "stopped by ben")


def test_a_lease_that_is_lost_while_a_motion_is_started_stops_it(cell, arm, clock):
    token = cell.leases.acquire("ana").token
    arm.during_start = lambda: clock.advance(5 * SECOND)
    assert begin(cell, arm, token).ended.result(0)[0] is Outcome.STOPPED


def test_a_fault_ends_a_motion_as_a_fault(cell, arm):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    arm.fail(Fault.LIMIT_GUARD, "velocity of 3 rad/s")
    assert run.ended.result(0) == (Outcome.FAULT, "velocity of 3 rad/s")


def test_the_reason_of_a_stop_is_not_that_of_a_later_one(cell, arm):
    token = cell.leases.acquire("ana").token
    begin(cell, arm, token)
    cell.stop("arm", "ben")
    run = begin(cell, arm, token)
    arm.stop()
    assert run.ended.result(0) == (Outcome.STOPPED, "stopped on its path")


def test_the_reason_of_a_stop_outlives_a_move_that_is_refused_meanwhile(cell, arm):
    token = cell.leases.acquire("ana").token
    run = begin(cell, arm, token)
    cell.runs.halt([arm], "halted by 'ben'", is_quickest=True)
    with pytest.raises(StateError, match="not holding"):
        cell.runs.begin(
            arm, arm.commanded, motion=None, token=token, stops=cell.runs.stops(arm),
            is_owned=lambda: True,
        )  # fmt: skip
    arm.stop()
    assert run.ended.result(0) == (Outcome.STOPPED, "halted by 'ben'")


def test_an_abandoned_motion_is_stopped_but_not_the_one_after_it(cell, arm):
    token = cell.leases.acquire("ana").token
    first = begin(cell, arm, token)
    arm.finish()
    second = begin(cell, arm, token)
    cell.runs.abandon(first, "gone")
    assert not second.ended.done()
    cell.runs.abandon(second, "gone")
    assert second.ended.result(0) == (Outcome.STOPPED, "gone")


def test_a_device_that_is_not_ready_to_move_is_refused(cell, arm):
    arm.state = ServoState.IDLE
    with pytest.raises(StateError, match="idle, not holding"):
        plan(cell, arm)


def test_a_bad_motion_is_refused_by_its_field(cell, arm):
    with pytest.raises(RequestError, match=r"^keyframes: expected at least 1, got 0"):
        asyncio.run(cell.plan(arm, PlanCall(b"")))
    with pytest.raises(RequestError, match=r"^motion: cannot be read"):
        asyncio.run(cell.plan(arm, PlanCall(b"nonsense")))
    keyframes = [
        Keyframe(tuple(exp([0.0, 0.0, angle])), time) for angle, time in ((0.0, 0.0), (1.0, 0.1))
    ]
    with pytest.raises(LimitError) as refused:
        plan(cell, arm, MotionRequest(keyframes))
    assert refused.value.value > refused.value.limit


def test_a_motion_that_the_device_could_not_follow_is_refused(cell, arm):
    arm.refusal = "the elbow would be straight"
    with pytest.raises(PlanError, match="the elbow would be straight"):
        plan(cell, arm)


def test_a_kept_plan_is_found_by_its_name_and_device(cell, arm):
    motion = plan(cell, arm)
    assert cell.plans.find(arm.name, motion.id).id == motion.id
    for device, name in ((cell.device("leg"), motion.id), (arm, "nonsense")):
        with pytest.raises(UnknownNameError, match=r"^motion_id: device .* has no plan"):
            cell.plans.find(device.name, name)


def test_few_plans_are_kept(cell, arm):
    plans = [plan(cell, arm) for _ in range(KEPT_PLANS + 1)]
    with pytest.raises(UnknownNameError):
        cell.plans.find(arm.name, plans[0].id)
    assert cell.plans.find(arm.name, plans[1].id).id == plans[1].id


@pytest.mark.parametrize(
    ("where", "what"),
    [
        (State.at_rest((0.8, 0.6, 0.0, 0.0)), "rad from where device 'arm'"),
        (State.at_rest((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.1)), "0.1 m from where device 'arm'"),
    ],
)
def test_a_plan_that_begins_elsewhere_is_refused(cell, arm, where, what):
    token = cell.leases.acquire("ana").token
    motion = plan(cell, arm)
    arm.at = where
    with pytest.raises(StartError, match=what):
        start(cell, token, arm, motion, stops=0)


def test_a_name_may_be_left_out_where_there_is_one_device(cell):
    with pytest.raises(RequestError, match=r"^device: expected one of arm, leg, got nothing"):
        cell.device("")
    with pytest.raises(UnknownNameError, match=r"^device: expected one of arm, leg, got 'tail'"):
        cell.device("tail")
    alone = Cell(config.default_settings(), make_device=FakeDevice, planners=cell.planners)
    assert alone.device("").name == "arm"


def test_only_a_motion_can_be_paused_and_resumed(cell, arm):
    for name in ("pause", "resume"):
        with pytest.raises(StateError, match=f"device arm is holding: no motion to {name}"):
            moving(arm, name)
    begin(cell, arm, cell.leases.acquire("ana").token)
    assert moving(arm, "pause") is arm


def test_a_holder_has_a_name_of_one_line(cell):
    with pytest.raises(RequestError, match=r"^holder: "):
        cell.leases.acquire(" \n ")
    assert cell.leases.acquire("ana\nben " + "x" * 1000).holder.startswith("ana ben xxx")


def test_shutdown_stops_what_runs_and_takes_no_more(cell, arm):
    token = cell.leases.acquire("ana").token
    run = begin(cell, arm, token)
    motion = run.motion
    cell.shutdown()
    assert run.ended.result(0) == (Outcome.STOPPED, "the daemon is going down")
    assert arm.calls[-2:] == ["stop", "shutdown"]
    with pytest.raises(DaemonError, match="going down"):
        start(cell, token, arm, motion, stops=cell.runs.stops(arm))
    with pytest.raises(DaemonError, match="going down"):
        cell.check(token, arm)


def test_shutdown_ends_what_a_dead_servo_cannot(cell, arm):
    run = begin(cell, arm, cell.leases.acquire("ana").token)
    run.ended.add_done_callback(lambda _: None)
    arm.stop = lambda: arm.fail(Fault.SERVO_DIED, "the servo process was ended by signal 9")
    cell.shutdown()
    assert run.ended.result(0)[0] is Outcome.FAULT


def test_what_keeps_a_device_from_being_ready_is_told(cell, arm):
    assert cell.wait_ready(1.0) == []
    arm.failure = "no such device"
    assert cell.wait_ready(1.0) == ["device arm: no such device"]


def test_nobody_waits_for_devices_of_a_daemon_that_ends(cell, arm):
    arm.wait_ready = lambda timeout: False
    stopping = threading.Event()
    stopping.set()
    assert cell.wait_ready(3600.0, is_cancelled=stopping.is_set) == [
        "device arm: not ready after 3600 s"
    ]


def test_a_motion_that_is_planned_too_late_is_planned_again(cell, arm):
    token = cell.leases.acquire("ana").token
    arm.lateness = 2
    run, timing = move(cell, token, arm)
    assert (run.number, timing.attempts) == (1, 3)


def test_a_motion_waits_for_a_steady_speed_and_says_so(cell, arm):
    token = cell.leases.acquire("ana").token
    arm.unsteady = 2
    run, timing = move(cell, token, arm)
    assert (run.number, timing.attempts) == (1, 1)
    assert arm.calls.count("await_steady") == 2
    assert 0.0 < timing.waiting < timing.planning


def test_a_device_that_is_always_too_quick_is_said_to_be(cell, arm):
    token = cell.leases.acquire("ana").token
    arm.lateness = 100
    with pytest.raises(StateError, match="too quick for 6 plans: the path has passed record 3"):
        move(cell, token, arm)


def test_motions_with_one_start_time_are_compared(cell):
    token = cell.leases.acquire("ana").token
    runs = []
    for name, late_ns in (("arm", 3_000), ("leg", 11_000)):
        device = cell.device(name)
        move_options = MoveOptions(start_ns=5 * SECOND)
        run, _ = move(cell, token, device, move_options)
        device.began[run.number] = 5 * SECOND + late_ns
        runs.append(run)
    assert [cell.runs.starts(run) for run in runs] == [
        (pytest.approx(3e-6), pytest.approx(8e-6)),
        (pytest.approx(11e-6), pytest.approx(8e-6)),
    ]


def test_a_halt_leaves_the_path(cell, arm):
    cell.stop("arm", "ana", is_quickest=True)
    assert arm.calls[-1] == "halt"
