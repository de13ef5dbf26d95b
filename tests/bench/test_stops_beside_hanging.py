"""Time to a stop: on an idle daemon, and beside everything that hangs.

That of a request over gRPC counts until its answer, that of a lease from its end on, and that of
SIGTERM from the signal on, both until the device no longer moves on.

    python -m pytest tests/bench/test_stops_beside_hanging.py -m bench -s

What hangs are eight commands of other devices, and the name service.
"""

import contextlib
import signal
import statistics
import time

import grpc
import pytest
from hanging import HangingDaemon
from harness import DEVICE, spin, until
from test_servo import show

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.bench

ROUNDS = 8
AIM = 0.1
"""Aim for the median, s."""


def stop(daemon):
    daemon.stub.Stop(pb.StopRequest(device=DEVICE))


def cancel(daemon):
    number = daemon.started.motion_number
    daemon.stub.Stop(pb.StopRequest(device=DEVICE, motion_number=number))


def seize(daemon):
    request = pb.SeizeLeaseRequest(holder="test", reason="to end it", devices=[DEVICE])
    daemon.token = daemon.stub.SeizeLease(request).lease.token


def leave(daemon):
    daemon.stream.cancel()
    until(lambda: daemon.device().state != pb.STATE_STREAMING, "the stop")


def terminate(daemon):
    daemon.process.send_signal(signal.SIGTERM)
    until(lambda: daemon.device().state != pb.STATE_STREAMING, "the stop")


def expire(daemon):
    until(lambda: daemon.device().state != pb.STATE_STREAMING, "the stop")


def seconds(daemon, end, rounds=ROUNDS):
    """Return how long *end* took, each time with a motion under way."""
    taken = []
    for _ in range(rounds):
        daemon.move(spin(60.0))
        until(lambda: daemon.device().path_time > 0.1, "motion")
        began = time.monotonic()
        if end is expire:
            began += daemon.stub.RenewLease(pb.RenewLeaseRequest(token=daemon.token)).lease.seconds
        end(daemon)
        taken.append(time.monotonic() - began)
        with contextlib.suppress(grpc.RpcError):  # of a call that was cancelled, or of no daemon
            until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
            list(daemon.stream)
    return taken


def show_and_judge(end, idle, hanging):
    """Print both times; the longer one is short."""
    for what, taken in (("idle", idle), ("beside what hangs", hanging)):
        median, most = statistics.median(taken), max(taken)
        show(f"{end.__name__}, {what}", median=f"{median:.3f} s", longest=f"{most:.3f} s")
    assert statistics.median(hanging) < AIM


@pytest.mark.timeout(600)
@pytest.mark.parametrize("end", [stop, cancel, seize, leave])
def test_a_stop_takes_no_longer_beside_what_hangs(tmp_path, end):
    with HangingDaemon(tmp_path / "idle", has_names=True, lease=600.0) as daemon:
        idle = seconds(daemon, end)
    with HangingDaemon(tmp_path / "hanging", lease=600.0) as daemon:
        daemon.hang()
        hanging = seconds(daemon, end)
        daemon.assert_hangs()
    show_and_judge(end, idle, hanging)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("end", [terminate, expire])
def test_the_end_of_a_daemon_or_a_lease_takes_no_longer(tmp_path, end):
    lease = 4.0 if end is expire else 600.0
    taken = {True: [], False: []}
    for number in range(ROUNDS // 2):
        for is_idle, found in taken.items():
            folder = tmp_path / f"{number}-{is_idle}"
            with HangingDaemon(folder, has_names=is_idle, lease=lease) as daemon:
                if not is_idle:
                    daemon.hang()
                found += seconds(daemon, end, rounds=1)
    show_and_judge(end, taken[True], taken[False])
