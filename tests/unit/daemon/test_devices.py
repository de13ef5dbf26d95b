"""The devices: who may command which device, and what becomes of the motions."""

import asyncio
import contextlib
import threading
import time
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest
from direct_planners import DirectPlanners, order_of
from fake_device import FakeServo, servo_of, tend

from emulated_dynamixel import ManualClock
from orientd import config
from orientd.daemon.device import AT_ONCE, EventKind, MoveOptions, servo_limits_of
from orientd.daemon.devices import Devices
from orientd.errors import (
    DaemonError,
    Fault,
    LateError,
    LeaseError,
    NotYetError,
    RequestError,
    StateError,
    UnknownNameError,
)
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.protocol import control_pb2 as pb
from orientd.rotation import exp
from orientd.stream.records import ServoState
from orientd_loopback import LoopbackDriver

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


@pytest.fixture(autouse=True)
def no_processes(monkeypatch):
    monkeypatch.setattr("orientd.daemon.device.device.ServoProcess", FakeServo)


@pytest.fixture
def devices(clock, planners):
    settings = config.parse(SETTINGS, source="test")
    return Devices(settings, planners=planners, clock=clock)


@pytest.fixture
def arm(devices):
    return devices.device("arm")


@pytest.fixture
def servo(arm):
    return servo_of(arm)


class Names:
    """Record stops of one user; the name service may answer late."""

    def __init__(self):
        self.is_asked, self.may_answer = threading.Event(), threading.Event()
        self.may_answer.set()

    def log_stops(self, device, stops):
        self.is_asked.set()
        assert self.may_answer.wait(10.0)
        return "ben"


@pytest.fixture
def names(arm, monkeypatch):
    """Return what names the users that stop the arm without the daemon."""
    names = Names()
    monkeypatch.setattr(arm, "_stops", names)
    return names


def plan(devices, device, request=MOTION):
    motion = asyncio.run(device.plan(order_of(request)))
    devices.plans.keep(device.name, motion)
    return motion


def start(device, token, motion, options=AT_ONCE):
    async def begin():
        with device.expecting(options) as run:
            await device.run(run, motion, token=token)
        return run

    return asyncio.run(begin())


async def moved(device, token, order=None, options=AT_ONCE):
    with device.expecting(options) as run:
        await device.move(run, order or order_of(MOTION), token=token)
    return run


def move(device, token, order=None, options=AT_ONCE):
    return asyncio.run(moved(device, token, order, options))


def begin(devices, device, token):
    return start(device, token, plan(devices, device))


def settle(device):
    """Wait until a device has done what it was asked for."""
    for threads in (device.workers.stops, device.workers.commands):
        threads.submit(lambda: None).result(10.0)


def stop(devices, *arguments, **options):
    return asyncio.run(devices.stop(*arguments, **options))


def ended(device, run):
    """Return how a motion has ended, once the device's thread has looked."""
    settle(device)
    tend(device)
    return run.ended.result(0)


def test_an_expiry_alone_ends_hand_guiding(devices, arm, clock):
    arm.disable(is_freed=True)
    devices.leases.release(devices.leases.acquire("ana").token)
    settle(arm)
    assert arm.is_free
    devices.leases.acquire("ana")
    clock.advance(5 * SECOND)
    devices.leases.expire()
    settle(arm)
    assert not arm.is_free


def test_whoever_takes_an_expired_lease_finds_its_motion_stopped(devices, arm, clock):
    run = begin(devices, arm, devices.leases.acquire("ana").token)
    clock.advance(5 * SECOND)
    devices.leases.acquire("ben")
    assert ended(arm, run)[0] == pb.OUTCOME_STOPPED


def test_a_seized_device_whose_servo_did_not_answer_is_stopped_once_it_does(devices, arm, servo):
    run = begin(devices, arm, devices.leases.acquire("ana").token)
    servo.is_dead = True
    devices.leases.seize("ben", "", "an emergency", devices=["arm"])
    settle(arm)
    servo.is_dead = False
    asyncio.run(devices.end_unowned(["arm"]))
    assert ended(arm, run)[0] == pb.OUTCOME_STOPPED


def test_one_dead_servo_does_not_keep_the_others_from_stopping(devices, servo):
    servo.is_dead = True
    reason = r"no servo of arm answers the stop: .* did not answer stop.*; told to stop: leg"
    with pytest.raises(DaemonError, match=reason):
        stop(devices, "", "ben")
    assert "stop" in servo_of(devices.device("leg")).asked


def while_planned(monkeypatch, planners, act):
    """Have something done once a motion is planned and before it begins."""
    planning = planners.plan

    async def plan(*arguments, **options):
        motion = await planning(*arguments, **options)
        await act()
        return motion

    monkeypatch.setattr(planners, "plan", plan)


def test_a_stop_while_a_motion_is_planned_keeps_it_from_beginning(
    devices, arm, servo, planners, monkeypatch
):
    token = devices.leases.acquire("ana").token
    while_planned(monkeypatch, planners, partial(devices.stop, "arm", "ben"))
    with pytest.raises(StateError, match="stopped before it began: stopped by ben"):
        move(arm, token)
    assert servo.asked == ["stop"]
    monkeypatch.undo()
    assert not move(arm, token).reason


def test_a_lease_that_is_lost_while_a_motion_is_planned_keeps_it_from_beginning(
    devices, arm, servo, planners, monkeypatch
):
    token = devices.leases.acquire("ana").token

    async def release():
        devices.leases.release(token)

    while_planned(monkeypatch, planners, release)
    with pytest.raises(LeaseError, match="has expired or was released"):
        move(arm, token)
    assert servo.asked == []


@pytest.mark.usefixtures("names")
def test_a_stop_while_a_motion_is_started_stops_it(devices, arm, servo):
    # The stop finds the device still at rest.
    servo.during_start = lambda: servo.memory.stops.publish(False, 1, 2, 3)
    run = begin(devices, arm, devices.leases.acquire("ana").token)
    assert ended(arm, run) == (pb.OUTCOME_STOPPED, "stopped by ben")


def test_a_motion_that_is_yet_to_begin_outlives_the_one_that_it_replaces(devices, arm, servo):
    token = devices.leases.acquire("ana").token
    first = begin(devices, arm, token)
    with arm.expecting() as second:
        arm.abandon(first, "gone")
        assert not second.reason
        arm.stop("stopped by ben")
        assert second.reason == "stopped by ben"
    assert ended(arm, first) == (pb.OUTCOME_STOPPED, "gone")


def test_motions_that_have_not_ended_keep_their_order(arm):
    with contextlib.ExitStack() as stack:
        expected = [stack.enter_context(arm.expecting()) for _ in range(20)]
        assert arm.unfinished() == expected
        for queued in expected:
            arm.abandon(queued, "over")


def test_a_motion_whose_caller_goes_away_while_it_is_planned_is_forgotten(
    devices, arm, planners, monkeypatch
):
    token = devices.leases.acquire("ana").token

    async def go_away():
        planned = asyncio.Event()

        async def wait():
            planned.set()
            await asyncio.sleep(60.0)

        while_planned(monkeypatch, planners, wait)
        moving = asyncio.ensure_future(moved(arm, token))
        await planned.wait()
        moving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await moving

    asyncio.run(go_away())
    settle(arm)
    assert arm.unfinished() == []


def test_a_stop_counts_before_the_name_of_its_user_is_known(devices, arm, servo, names):
    token = devices.leases.acquire("ana").token
    names.may_answer.clear()

    async def begin():
        motion = await arm.plan(order_of(MOTION))
        with arm.expecting() as run:
            servo.memory.stops.publish(False, 1, 2, 3)
            watching = threading.Thread(target=partial(tend, arm))
            watching.start()
            assert names.is_asked.wait(10.0)
            with pytest.raises(StateError, match="was stopped before it began"):
                await arm.run(run, motion, token=token)
            names.may_answer.set()
            watching.join(10.0)
            assert run.reason == "stopped by ben"

    asyncio.run(begin())
    assert "start" not in servo.asked


def test_a_kept_plan_is_found_by_its_name_and_device(devices, arm):
    motion = plan(devices, arm)
    assert devices.plans.find(arm.name, motion.id).id == motion.id
    for device, name in ((devices.device("leg"), motion.id), (arm, "nonsense")):
        with pytest.raises(UnknownNameError, match=r"^motion_id: device .* has no plan"):
            devices.plans.find(device.name, name)


def test_a_name_may_be_left_out_where_there_is_one_device(devices):
    with pytest.raises(RequestError, match=r"^device: expected one of arm, leg, got nothing"):
        devices.device("")
    with pytest.raises(UnknownNameError, match=r"^device: expected one of arm, leg, got 'tail'"):
        devices.device("tail")
    alone = Devices(config.default_settings(), planners=devices.planners)
    assert alone.device("").name == "arm"


def test_shutdown_stops_what_runs_and_takes_no_more(devices, arm, servo):
    token = devices.leases.acquire("ana").token
    run = begin(devices, arm, token)
    asked = servo.ask

    def ask(command, **more):
        asked(command, **more)
        tend(arm)

    servo.ask = ask
    devices.shutdown()
    assert run.ended.result(0) == (pb.OUTCOME_STOPPED, "the daemon is going down")
    assert servo.asked[-2:] == ["stop", "end"]
    with pytest.raises(DaemonError, match="going down"):
        devices.check(token, arm, "")


def test_what_keeps_a_device_from_being_ready_is_told(devices, servo):
    servo_of(devices.device("leg")).wait_ready = lambda timeout: True
    servo.wait_ready = lambda timeout: False
    servo.fail(Fault.SERVO_DIED, "no such device")
    assert devices.wait_ready(1.0) == ["device arm: no such device"]


def test_a_motion_waits_for_a_steady_speed_and_says_so(devices, arm, servo):
    servo.refusals = 2 * [NotYetError("the speed is changing")]
    order = order_of(MOTION)
    run = move(arm, devices.leases.acquire("ana").token, order)
    assert run.attempts == 1
    assert sum(order.waits) >= 2 * 0.002


def test_a_device_that_is_always_too_quick_is_said_to_be(devices, arm, servo):
    servo.refusals = 100 * [LateError("the path has passed record 3, it is at 4")]
    with pytest.raises(StateError, match="too quick for 6 plans: the path has passed record 3"):
        move(arm, devices.leases.acquire("ana").token)


def test_a_motion_is_planned_again_if_a_queued_one_begins_meanwhile(
    devices, arm, servo, planners, monkeypatch
):
    token = devices.leases.acquire("ana").token
    order = order_of(replace(MOTION, approach=True))
    first = begin(devices, arm, token)
    servo.refusals.append(LateError("the path has passed record 3"))
    second = move(arm, token, order, MoveOptions(is_queued=True))
    servo.finish()

    async def look():
        tend(arm)

    while_planned(monkeypatch, planners, look)
    third = move(arm, token, order)
    assert third.attempts == 2
    assert ended(arm, first)[0] == pb.OUTCOME_DONE
    assert ended(arm, second)[0] == pb.OUTCOME_REPLACED


def test_a_device_knows_when_motions_with_a_start_time_began(devices, arm, servo):
    start_ns = time.monotonic_ns() + 10 * SECOND
    run = move(arm, devices.leases.acquire("ana").token, options=MoveOptions(start_ns=start_ns))
    run.meter = SimpleNamespace(began_ns=start_ns + 7, end=print)
    assert arm.began_ns(start_ns) == start_ns + 7
    servo.finish()
    ended(arm, run)
    assert arm.began_ns(start_ns) == start_ns + 7
    assert arm.began_ns(start_ns + 1) is None


def test_a_motion_that_is_ready_only_after_its_start_time_does_not_begin(devices, arm, servo):
    late = MoveOptions(start_ns=time.monotonic_ns() - 1)
    with pytest.raises(StateError, match=r"was ready 0\.\d{3} s after its start time"):
        move(arm, devices.leases.acquire("ana").token, options=late)
    assert "start" not in servo.asked


def test_the_options_of_a_motion_are_not_those_of_the_next(devices, arm, servo, monkeypatch):
    monkeypatch.setattr(LoopbackDriver, "tune", lambda *_: None, raising=False)
    token, tuned = devices.leases.acquire("ana").token, []
    for options in ({}, {"gain": 700}, {"gain": 700}, {"lookahead": 0.1}, {}, {}):
        servo.asked.clear()
        motion = plan(devices, arm, replace(MOTION, device_options=options))
        run = start(arm, token, motion)
        tuned.append(servo.tuning() if "tune" in servo.asked else None)
        servo.finish()
        ended(arm, run)
    assert tuned == [None, {"gain": 700}, None, {"lookahead": 0.1}, {}, None]


def test_a_halt_leaves_the_path(devices, servo):
    stop(devices, "arm", "ana", is_quickest=True)
    assert servo.asked[-1] == "halt"


def test_all_devices_are_stopped_at_once(devices):
    together = threading.Barrier(2)
    for device in devices.by_name.values():
        servo_of(device).ask = lambda command: together.wait(10.0)
    stop(devices, "", "ben")
    assert not together.broken


@pytest.mark.parametrize("speed", [0.0, -0.5, 1.5, float("nan")])
def test_a_speed_that_is_none_or_above_the_planned_one_is_refused(arm, speed):
    with pytest.raises(ValueError, match="speed must be above 0 and at most 1"):
        arm.set_speed(speed)


class Held:
    """A lock that a command holds for as long as the test lasts."""

    def acquire(self, blocking=True, timeout=-1):
        assert not blocking, "a look waits for a command"
        return False


def test_a_look_at_a_device_in_a_fault_waits_for_no_command(arm, servo, monkeypatch):
    servo.be(ServoState.FAULT)  # the reason has not been heard yet
    monkeypatch.setattr(arm, "_lock", Held())
    assert arm.snapshot().state is ServoState.FAULT


def test_a_second_reset_is_refused_while_the_first_one_hangs(arm, servo):
    resetting, done = threading.Event(), threading.Event()

    def ask(command, **more):
        resetting.set()
        done.wait(30.0)

    servo.ask = ask
    first = arm.workers.commands.submit(arm.reset)
    resetting.wait(10.0)
    second = arm.workers.stops.submit(arm.reset)
    try:
        with pytest.raises(StateError, match="device arm: another reset is under way"):
            second.result(5.0)
    finally:
        done.set()
    first.result(10.0)


def test_shutdown_ends_a_motion_whose_end_nobody_has_seen(devices, arm):
    run = begin(devices, arm, devices.leases.acquire("ana").token)
    devices.shutdown()
    assert run.ended.result(0) == (pb.OUTCOME_STOPPED, "the daemon is going down")


def test_a_new_servo_gets_the_options_of_a_motion_again(devices, arm, servo, monkeypatch):
    monkeypatch.setattr(LoopbackDriver, "tune", lambda *_: None, raising=False)
    token, request = devices.leases.acquire("ana").token, replace(MOTION, device_options={"a": 1})
    for is_new in (True, False, True):
        servo.asked.clear()
        run = start(arm, token, plan(devices, arm, request))
        assert ("tune" in servo.asked) is is_new
        servo.finish()
        ended(arm, run)
        if not is_new:
            servo.is_alive, servo.wait_ready = False, lambda _: True
            servo.start = partial(setattr, servo, "is_alive", True)
            arm.reset()


def test_the_options_of_a_motion_change_at_rest_only(devices, arm, servo, monkeypatch):
    monkeypatch.setattr(LoopbackDriver, "tune", lambda *_: None, raising=False)
    token = devices.leases.acquire("ana").token
    first = begin(devices, arm, token)
    other = replace(MOTION, device_options={"gain": 700}, approach=True)
    with pytest.raises(StateError, match="device_options change at rest only: wait for the"):
        move(arm, token, order_of(other))
    assert "splice" not in servo.asked
    assert not first.ended.done()


def test_the_event_at_the_end_of_targets_says_the_fault(devices, arm, servo, monkeypatch):
    events, token = [], devices.leases.acquire("ana").token
    monkeypatch.setattr(arm, "_on_event", events.append)
    with arm.expecting() as run:
        arm.track(run, servo_limits_of(Limits.partial(), 1.0), token=token)
    servo.fall(Fault.LINK_LOST, "no answer on the line")
    assert ended(arm, run) == (pb.OUTCOME_FAULT, "no answer on the line")
    stopped = [one.text for one in events if one.kind is EventKind.MOTION_STOPPED]
    assert stopped == ["no answer on the line"]
