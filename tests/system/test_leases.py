"""Whose motion it is: several terminals, users and devices at one daemon, through real processes."""

import json
import os
import signal

import pytest
from command_line import assert_refused, begin, environment, inside, orientd
from harness import DEVICE, DaemonProcess, until

import orientd as package
from orientd.errors import LeaseError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.reports import Outcome

LEG = "leg"
TURN = [{"rotation_vector": [0.0, 0.0, 0.1]}]
LONG = [
    {"time": 0.0, "rotation_vector": [0.0, 0.0, 0.1]},
    {"time": 3.0, "rotation_vector": [0.3, 0.0, 0.1]},
]


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    process = DaemonProcess(tmp_path_factory.mktemp("daemon"), lease=5.0)
    text = process.config.read_text()
    process.config.write_text(f'{text}\n[devices.{LEG}]\ndriver = "loopback"\n')
    with process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


@pytest.fixture
def ana(daemon):
    with package.connect(daemon.socket, holder="ana") as robot:
        yield robot


@pytest.fixture
def ben(daemon):
    with package.connect(daemon.socket, holder="ben") as robot:
        yield robot


@pytest.fixture
def files(tmp_path):
    paths = tmp_path / "long.json", tmp_path / "bad.json"
    paths[0].write_text(json.dumps({"keyframes": LONG, "approach": True}))
    paths[1].write_text(json.dumps({"keyframes": [*TURN, *TURN], "limits": {"velocity": 1e9}}))
    return paths


def moving(daemon, number):
    def is_there():
        device = daemon.device()
        return device.motion_number == number and device.path_time > 0.1

    until(is_there, f"motion {number}")


def test_two_people_command_two_devices(ana, ben):
    ours = ana.move(LONG, device=DEVICE, approach=True)
    theirs = ben.move(TURN, device=LEG)
    with pytest.raises(LeaseError, match="the lease of leg is held by 'ben'"):
        ana.pause(LEG)
    assert theirs.wait(20.0).outcome is Outcome.DONE
    assert ours.wait(20.0).outcome is Outcome.DONE
    held = {one.holder: one.devices for one in ana.state().daemon.leases}
    assert held == {"ana": (DEVICE,), "ben": (LEG,)}


def test_a_move_of_no_device_in_particular_takes_no_lease(ana):
    with pytest.raises(package.errors.RequestError, match="expected one of arm, leg, got nothing"):
        ana.move(TURN)
    assert ana.state().daemon.leases == ()


def test_without_names_a_client_takes_every_device_as_it_always_did(daemon):
    lease = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="old")).lease
    assert list(lease.devices) == [DEVICE, LEG]
    for name in (DEVICE, LEG):
        daemon.stub.Enable(pb.EnableRequest(lease_token=lease.token, device=name))
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=lease.token))


def test_other_terminals_leave_the_holders_motion_alone(daemon, ana, files):
    """Refused, failed and killed commands of the same user, with and without sharing."""
    slow, bad = files
    motion = ana.move(LONG, device=DEVICE, approach=True)
    moving(daemon, motion.motion_number)
    at = ("--device", DEVICE, "--socket", daemon.socket)
    shared = environment(ORIENTD_LEASE=ana.lease_token)
    assert_refused(inside("move", slow, *at), "the lease of arm is held by 'ana'")
    assert_refused(inside("move", slow, "--queue", *at), "the lease of arm is held by 'ana'")
    assert_refused(inside("move", slow, "--lease", *at), "no command of yours here holds the lease")
    assert_refused(orientd("move", bad, *at, env=shared), "velocity")
    killed = begin("move", slow, "--queue", *at, env=shared)
    until(lambda: _waits(daemon), "the queued motion")
    killed.kill()
    killed.communicate()
    ended = begin("move", slow, "--queue", *at, env=shared)
    until(lambda: _waits(daemon, 2), "the other queued motion")
    ended.send_signal(signal.SIGINT)
    _, errors = ended.communicate(timeout=20)
    assert f"(user:{os.getuid()})" in errors.partition("stopped by")[2]
    assert motion.wait(20.0).outcome is Outcome.DONE


def _waits(daemon, count=1):
    text = (daemon.folder / "log").read_text()
    return text.rpartition("is commanded by ana")[2].count("commanded by") >= count or (
        text.count("orientd move") >= count and text.count("motion started") >= count + 1
    )
