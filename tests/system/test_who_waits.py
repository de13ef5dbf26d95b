"""Nobody who stops a device waits behind a device, a caller or a name service that hangs."""

import signal

import grpc
import harness
import pytest
from hanging import SLOW, HangingDaemon
from harness import DEVICE, spin, until

import orientd
from orientd.errors import MotionStopped
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

TURN = [{"rotation_vector": [0, 0, 2.5]}]
SLOWLY = {"velocity": 0.1}


@pytest.fixture
def daemon(tmp_path, request, monkeypatch):
    """A daemon whose device moves while eight commands and the name service hang."""
    process = HangingDaemon(tmp_path, lease=getattr(request, "param", 120.0))
    if not harness.MACHINE.is_patient:
        process.share(monkeypatch)
    with process:
        process.hang()
        process.move(spin(60.0))
        until(lambda: process.device().path_time > 0.1, "motion")
        yield process


def ended(stream):
    """Wait for the end of a motion, and return why it was stopped."""
    *_, last = stream
    assert last.summary.outcome == pb.OUTCOME_STOPPED
    return last.summary.text


@pytest.mark.parametrize("call", ["Stop", "Halt"])
def test_a_stop_is_answered(daemon, call):
    getattr(daemon.stub, call)(pb.StopRequest(device=DEVICE))
    daemon.assert_hangs()
    assert "stopped by" in ended(daemon.stream)
    daemon.assert_hangs()


@pytest.mark.parametrize("call", ["Stop", "Halt"])
@pytest.mark.parametrize("device", ["", "slow3"])
def test_a_device_that_does_not_answer_is_never_called_stopped(daemon, call, device):
    with pytest.raises(grpc.RpcError) as failed:
        getattr(daemon.stub, call)(pb.StopRequest(device=device))
    daemon.assert_hangs()
    silent = device or ", ".join(SLOW)
    assert f"no servo of {silent} answers the {call.lower()}" in failed.value.details()
    assert "slow3: enable is under way" in failed.value.details()
    if not device:
        assert failed.value.details().endswith(f"told to stop: {DEVICE}")
        assert "stopped by" in ended(daemon.stream)
        daemon.assert_hangs()


def test_a_motion_is_cancelled(daemon):
    number = daemon.started.motion_number
    daemon.stub.Stop(pb.StopRequest(device=DEVICE, motion_number=number))
    assert "stopped by" in ended(daemon.stream)
    daemon.assert_hangs()


def test_a_motion_begins_and_its_handle_cancels_it(daemon):
    daemon.stub.Stop(pb.StopRequest(device=DEVICE))
    ended(daemon.stream)
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
    with orientd.connect(daemon.socket) as robot:
        handle = robot.move(TURN, device=DEVICE, limits=SLOWLY)
        handle.cancel()
        with pytest.raises(MotionStopped):
            handle.wait()
    daemon.assert_hangs()


def test_the_motion_of_a_caller_that_has_gone_is_ended(daemon):
    daemon.stream.cancel()
    until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
    daemon.assert_hangs()


def test_a_lease_is_released_and_its_motion_ended(daemon):
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
    assert "was released" in ended(daemon.stream)
    daemon.assert_hangs()


def test_a_lease_is_seized_and_its_motion_ended(daemon):
    request = pb.SeizeLeaseRequest(holder="ben", reason="mine", devices=[DEVICE])
    daemon.stub.SeizeLease(request)
    assert "was seized" in ended(daemon.stream)
    daemon.assert_hangs()


@pytest.mark.parametrize("daemon", [3.0], indirect=True)
def test_a_lease_that_nobody_renews_ends_and_with_it_its_motion(daemon):
    assert "has expired" in ended(daemon.stream)
    daemon.assert_hangs()


def test_a_daemon_that_is_to_end_stops_its_devices(daemon):
    daemon.process.send_signal(signal.SIGTERM)
    assert "going down" in ended(daemon.stream)
    daemon.assert_hangs()
