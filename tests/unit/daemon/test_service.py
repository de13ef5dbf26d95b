"""The calls of the service, from a request to a device without a servo."""

import asyncio
import contextlib
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from direct_planners import DirectPlanners
from fake_device import FakeServo, servo_of

from emulated_dynamixel import ManualClock
from orientd import config
from orientd.config import Role
from orientd.daemon.access.identity import Caller, Identity
from orientd.daemon.calls.service import Service
from orientd.daemon.devices import Devices
from orientd.errors import DaemonError, LeaseError, RequestError, UnknownNameError
from orientd.protocol import control_pb2 as pb

SETTINGS = {
    "daemon": {"lease_seconds": 5.0},
    "devices": {"arm": {"driver": "loopback"}, "leg": {"driver": "loopback"}},
}
ANA = Caller(SimpleNamespace(), "test", Identity("user:1", "ana", Role.OPERATOR))
BEN = Caller(SimpleNamespace(), "test", Identity("user:2", "ben", Role.OPERATOR))
TURN = pb.MotionRequest(
    keyframes=[pb.Keyframe(rotation_vector=pb.Vector3(z=angle)) for angle in (0.0, 0.1)]
)


@pytest.fixture(scope="module")
def planners():
    return DirectPlanners(config.parse(SETTINGS, source="test").devices.values())


@pytest.fixture
def devices(planners, monkeypatch):
    monkeypatch.setattr("orientd.daemon.device.device.ServoProcess", FakeServo)
    settings = config.parse(SETTINGS, source="test")
    made = Devices(settings, planners=planners, clock=ManualClock(1))
    yield made
    made.close()


@pytest.fixture
def service(devices):
    return Service(devices, keyframes=3, socket=Path("/run/x"), configuration="", began=0.0)


def lease_of(service, caller=ANA, **more):
    request = pb.AcquireLeaseRequest(holder="test", **more)
    return asyncio.run(service.AcquireLease(request, caller)).lease


def started(service, request, caller=ANA):
    """Return the first answer of a move, and let the caller go away."""

    async def first():
        async with contextlib.aclosing(service.Move(request, caller)) as answers:
            return (await anext(answers)).started

    return asyncio.run(first())


def test_commands_need_the_lease(service, devices):
    with pytest.raises(LeaseError, match="needs the lease"):
        asyncio.run(service.Enable(pb.CommandRequest(device="arm"), ANA))
    token = lease_of(service).token
    answer = asyncio.run(service.Enable(pb.CommandRequest(device="arm", lease_token=token), ANA))
    assert answer.device.name == "arm"
    assert servo_of(devices.device("arm")).asked == ["enable"]


def test_commands_to_a_device_are_done_in_the_order_in_which_they_come(
    service, devices, monkeypatch
):
    token, begun = lease_of(service).token, []
    monkeypatch.setattr(devices.device("arm"), "set_speed", begun.append)

    async def commands():
        requests = [
            pb.SetSpeedRequest(lease_token=token, device="arm", speed=speed)
            for speed in (0.3, 0.5, 0.7)
        ]
        await asyncio.gather(*[service.SetSpeed(one, ANA) for one in requests])

    asyncio.run(commands())
    assert begun == pytest.approx([0.3, 0.5, 0.7])


def test_a_move_without_a_token_takes_the_lease_of_its_device_and_returns_it(service, devices):
    request = pb.MoveRequest(device="arm", motion=TURN, holder="ana's program")
    begun = started(service, request)
    assert (begun.motion_number, begun.lease.devices) == (1, ["arm"])
    assert begun.lease.seconds == 5.0
    (held,) = devices.leases.held()
    assert (held.token, held.holder, held.owner) == (begun.lease.token, "ana's program", "user:1")


def test_a_move_with_a_token_returns_no_lease(service):
    request = pb.MoveRequest(device="arm", motion=TURN, lease_token=lease_of(service).token)
    assert not started(service, request).HasField("lease")


def test_a_move_takes_no_lease_that_somebody_holds_but_beside_its_own_on_purpose(service, devices):
    lease_of(service, devices=["arm"])
    request = pb.MoveRequest(device="arm", motion=TURN, holder="another")
    for caller in (ANA, BEN):
        with pytest.raises(LeaseError, match="the lease of arm is held by 'test'"):
            started(service, request, caller)
    request.beside = True
    with pytest.raises(LeaseError, match="held by 'test'"):
        started(service, request, BEN)
    assert started(service, request, ANA).lease.token
    assert len(devices.leases.held()) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        {"motion": pb.MotionRequest()},
        {"motion_id": "nonsense"},
        {},
        {"motion": TURN, "blend_tolerance": 0.1},
        {"motion": pb.MotionRequest(keyframes=[TURN.keyframes[0]] * 4)},
    ],
    ids=["empty", "no such plan", "nothing", "a wrong option", "too many keyframes"],
)
def test_a_move_that_does_not_begin_gives_the_lease_back_that_it_took(service, devices, wrong):
    with pytest.raises((RequestError, UnknownNameError)):
        started(service, pb.MoveRequest(device="arm", holder="ana", **wrong))
    assert devices.leases.held() == []


def test_the_daemon_reports_its_leases_in_the_order_in_which_they_were_taken(service):
    lease_of(service, devices=["leg"])
    lease_of(service, BEN, devices=["arm"])
    report = service.daemon_report()
    assert [one.identity for one in report.leases] == ["user:1", "user:2"]


def test_a_lease_that_a_move_takes_outlasts_its_planning(planners, monkeypatch):
    monkeypatch.setattr("orientd.daemon.device.device.ServoProcess", FakeServo)
    settings = config.parse({**SETTINGS, "daemon": {"lease_seconds": 0.3}}, source="test")
    devices = Devices(settings, planners=planners)
    service = Service(devices, keyframes=3, socket=Path("/run/x"), configuration="", began=0.0)
    held = []

    async def plan_slowly(*_):
        await asyncio.sleep(1.0)
        held.extend(devices.leases.held())
        raise RequestError("motion", "is none")

    service._begin = plan_slowly
    with pytest.raises(RequestError):
        started(service, pb.MoveRequest(device="arm", motion=TURN, holder="ana"))
    assert [one.holder for one in held] == ["ana"]
    assert devices.leases.held() == []
    devices.close()


def test_a_following_whose_caller_goes_away_while_it_starts_is_ended(service, devices):
    arm, token = devices.device("arm"), lease_of(service).token
    servo, gone = servo_of(arm), threading.Event()

    async def requests():
        yield pb.TrackRequest(start=pb.TrackStart(device="arm", lease_token=token))
        await asyncio.Event().wait()

    async def follow():
        async for _ in service.Track(requests(), ANA):
            pass

    async def go_away():
        loop, following = asyncio.get_running_loop(), asyncio.ensure_future(follow())

        def leave():
            loop.call_soon_threadsafe(following.cancel)
            gone.wait(10.0)

        servo.during_start = leave
        with pytest.raises(asyncio.CancelledError):
            await following
        gone.set()

    asyncio.run(go_away())
    arm.workers.commands.submit(lambda: None).result(10.0)
    assert (servo.asked[0], {*servo.asked[1:]}) == ("track", {"stop"})


def moving_and_silent(service, devices):
    """Return the lease under which the arm moves, whose servo answers no more."""

    async def begin():
        lease = (await service.AcquireLease(pb.AcquireLeaseRequest(holder="test"), ANA)).lease
        request = pb.MoveRequest(device="arm", motion=TURN, lease_token=lease.token)
        moving = service.Move(request, ANA)
        await anext(moving)
        servo_of(devices.device("arm")).is_dead = True
        return lease, moving

    return begin()


SILENT = "no servo of arm answers the stop: it may still move .*; told to stop: leg"


def test_a_lease_is_not_said_to_be_released_while_its_motion_may_go_on(service, devices):
    async def release():
        lease, _ = await moving_and_silent(service, devices)
        with pytest.raises(DaemonError, match=SILENT):
            await service.ReleaseLease(pb.ReleaseLeaseRequest(token=lease.token), ANA)

    asyncio.run(release())
    assert devices.leases.held() == []


def test_a_lease_is_not_said_to_be_seized_while_the_motion_of_its_holder_may_go_on(
    service, devices
):
    request = pb.SeizeLeaseRequest(holder="ben", reason="mine")

    async def seize():
        await moving_and_silent(service, devices)
        with pytest.raises(DaemonError, match=SILENT):
            await service.SeizeLease(request, BEN)
        assert devices.leases.held() == []
        servo_of(devices.device("arm")).is_dead = False
        return (await service.SeizeLease(request, BEN)).lease

    assert list(asyncio.run(seize()).devices) == ["arm", "leg"]
