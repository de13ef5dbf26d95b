"""Leases of terminals, users and devices at one daemon, through real processes."""

import json
import os
import signal
import time
from contextlib import closing

import pytest
from command_line import assert_refused, begin, environment, inside, orientd
from harness import DEVICE, DaemonProcess, nudge, until

import orientd as package
from orientd.errors import LeaseError
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

LEG = "leg"
TURN = [{"rotation_vector": [0.0, 0.0, 0.1]}]
LONG = [
    {"time": 0.0, "rotation_vector": [0.0, 0.0, 0.1]},
    {"time": 3.0, "rotation_vector": [0.3, 0.0, 0.1]},
]


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    with DaemonProcess(tmp_path_factory.mktemp("daemon"), lease=30.0, others=[LEG]) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@pytest.fixture
def ana(daemon):
    with closing(package.connect(daemon.socket, holder="ana")) as robot:
        yield robot


@pytest.fixture
def ben(daemon):
    with closing(package.connect(daemon.socket, holder="ben")) as robot:
        yield robot


@pytest.fixture
def files(tmp_path):
    paths = tmp_path / "long.json", tmp_path / "bad.json"
    paths[0].write_text(json.dumps({"keyframes": LONG, "approach": True}))
    paths[1].write_text(json.dumps({"keyframes": [*TURN, *TURN], "limits": {"velocity": 1e9}}))
    return paths


def test_two_people_command_two_devices(ana, ben):
    ours = ana.move(LONG, device=DEVICE, approach=True)
    theirs = ben.move(TURN, device=LEG)
    with pytest.raises(LeaseError, match="the lease of leg is held by 'ben'"):
        ana.pause(LEG)
    assert theirs.wait(20.0).outcome == pb.OUTCOME_DONE
    assert ours.wait(20.0).outcome == pb.OUTCOME_DONE
    held = {one.holder: one.devices for one in ana.state().daemon.leases}
    assert held == {"ana": [DEVICE], "ben": [LEG]}


def test_a_client_that_returns_one_device_keeps_the_other(ana):
    ana.acquire_lease(DEVICE)
    ana.acquire_lease(LEG)
    ana.release_lease(DEVICE)
    assert [list(one.devices) for one in ana.state().daemon.leases] == [[LEG]]
    assert ana.move(TURN, device=LEG, approach=True).wait(20.0).outcome == pb.OUTCOME_DONE


def test_a_move_of_no_device_in_particular_takes_no_lease(ana):
    with pytest.raises(package.errors.RequestError, match="expected one of arm, leg, got nothing"):
        ana.move(TURN)
    assert not ana.state().daemon.leases


def test_without_names_a_client_takes_every_device_as_it_always_did(daemon):
    lease = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="old")).lease
    assert list(lease.devices) == [DEVICE, LEG]
    for name in (DEVICE, LEG):
        daemon.stub.Enable(pb.CommandRequest(lease_token=lease.token, device=name))
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=lease.token))


def test_refused_terminals_leave_the_holders_motion_alone(daemon, ana, files):
    slow, bad = files
    motion = ana.move(LONG, device=DEVICE, approach=True)
    at = ("--device", DEVICE, "--socket", daemon.socket)
    shared = environment(ORIENTD_LEASE="1")
    assert_refused(inside("move", slow, *at), "the lease of arm is held by 'ana'")
    assert_refused(inside("move", slow, "--queue", *at), "the lease of arm is held by 'ana'")
    assert_refused(orientd("move", bad, *at, env=shared), "velocity")
    assert motion.wait(20.0).outcome == pb.OUTCOME_DONE


@pytest.mark.parametrize("seconds", [3.0, 30.0], ids=["in the ring", "not in the ring yet"])
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_queued_move_that_ends_early_leaves_the_holders_motion_alone(
    daemon, ana, files, how, seconds
):
    keyframes = [LONG[0], {**LONG[1], "time": seconds}]
    motion = ana.move(keyframes, device=DEVICE, approach=True)
    ana.pause(DEVICE)
    at = ("--device", DEVICE, "--socket", daemon.socket)
    shared = environment(ORIENTD_LEASE="1")
    queued = begin("move", files[0], "--queue", *at, env=shared)
    assert queued.stdout.readline().startswith(f"motion {motion.motion_number + 1}")
    queued.send_signal(how)
    if how is signal.SIGKILL or seconds > 8.0:
        _, errors = queued.communicate(timeout=20)
    ana.resume(DEVICE)
    if seconds > 8.0:
        until(lambda: daemon.device().path_time > 0.1, "the motion to go on")
        ana.stop(DEVICE)
        assert motion.wait(20.0, check=False).text.startswith("stopped by ")
    else:
        assert motion.wait(20.0).outcome == pb.OUTCOME_DONE
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
        _, errors = queued.communicate(timeout=20)
    if how is signal.SIGINT:
        assert f"(user:{os.getuid()})" in errors.partition("stopped by")[2]
    else:
        ana.seize_lease("whoever shared it was killed")


def test_a_lease_that_a_move_takes_has_its_full_time_when_the_motion_begins(tmp_path):
    daemon = DaemonProcess(tmp_path, lease=2.0)
    daemon.config.write_text(f"{daemon.config.read_text()}[planner]\nprocesses = 1\n")
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        planners = daemon.planners()
        for planner in planners:
            os.kill(planner, signal.SIGSTOP)
        stream = daemon.stub.Move(pb.MoveRequest(motion=nudge(0.1), holder="ana"))
        time.sleep(3.0)
        for planner in planners:
            os.kill(planner, signal.SIGCONT)
        assert 1.0 < next(iter(stream)).started.lease.seconds <= 2.0
