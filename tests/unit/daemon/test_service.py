"""The calls of the service, from a request to a device without a servo."""

import asyncio
import contextlib
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from direct_planners import DirectPlanners
from fake_device import FakeServo, servo_of
from motions import through

from emulated_dynamixel import ManualClock
from orientd import config
from orientd.config import Role
from orientd.daemon.access.identity import Caller, Identity
from orientd.daemon.calls.service import Service
from orientd.daemon.devices import Devices
from orientd.errors import DaemonError
from orientd.protocol import control_pb2 as pb

SETTINGS = {
    "daemon": {"lease_seconds": 5.0},
    "devices": {"arm": {"driver": "loopback"}, "leg": {"driver": "loopback"}},
}
ANA = Caller(SimpleNamespace(), "test", Identity("user:1", "ana", Role.OPERATOR))
BEN = Caller(SimpleNamespace(), "test", Identity("user:2", "ben", Role.OPERATOR))
TURN = through([(0, 0, 0), (0, 0, 0.1)])


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
            return pb.MoveResponse.FromString((await anext(answers)).content).started

    return asyncio.run(first())


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
