"""Time to the answer of a stop over gRPC: on an idle daemon, and beside everything that hangs.

    python -m pytest tests/bench/test_stops_beside_hanging.py -m bench -s

What hangs are eight commands of other devices, and the name service.
"""

import contextlib
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


def seconds(daemon, end):
    """Return how long *end* took, each time with a motion under way."""
    taken = []
    for _ in range(ROUNDS):
        daemon.move(spin(60.0))
        until(lambda: daemon.device().path_time > 0.1, "motion")
        began = time.monotonic()
        end(daemon)
        taken.append(time.monotonic() - began)
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
        with contextlib.suppress(grpc.RpcError):  # of a call that was cancelled
            list(daemon.stream)
    return taken


@pytest.mark.timeout(600)
@pytest.mark.parametrize("end", [stop, cancel, seize, leave])
def test_a_stop_takes_no_longer_beside_what_hangs(tmp_path, end):
    with HangingDaemon(tmp_path / "idle", has_names=True, lease=600.0) as daemon:
        idle = seconds(daemon, end)
    with HangingDaemon(tmp_path / "hanging", lease=600.0) as daemon:
        daemon.hang()
        hanging = seconds(daemon, end)
        daemon.assert_hangs()
    for what, taken in (("idle", idle), ("beside what hangs", hanging)):
        median, most = statistics.median(taken), max(taken)
        show(f"{end.__name__}, {what}", median=f"{median:.3f} s", longest=f"{most:.3f} s")
    assert statistics.median(hanging) < AIM
