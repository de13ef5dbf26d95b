"""The servo's punctuality, compared with a bare C loop, and the cost of the processes."""

import os
import signal
import subprocess
import sys
import time

import grpc
import pytest
from grpclib.health.v1.health_pb2 import HealthCheckRequest, HealthCheckResponse
from harness import DEVICE, DaemonProcess, health, resident_kib, spin
from servo_lateness import compare, conditions

from orientd.config import SPIN_US
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.bench

# A client that looks again every 20 ms, where gRPC would wait for a second.
EAGER = [
    (f"grpc.{name}_reconnect_backoff_ms", milliseconds)
    for name, milliseconds in (("initial", 20), ("min", 20), ("max", 50))
]


def show(title, **figures):
    print(f"\n{title}: " + ", ".join(f"{name} {figure}" for name, figure in figures.items()))


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "condition",
    conditions(),
    ids=lambda c: (
        f"{c.rate_hz:g}-{'busy' if c.is_loaded else 'idle'}-"
        f"{'fifo' if c.priority else 'other'}-spin{c.spin_us}"
    ),
)
def test_lateness_beside_a_bare_loop(condition):
    found = compare(condition, slots=6, seconds=5.0)
    ours, bare = found.overruns
    show(
        f"{condition}",
        p99_us=[round(slot.p99_us, 1) for slot in found.servo],
        bare_p99_us=[round(slot.p99_us, 1) for slot in found.bare],
        ratio=round(found.p99_ratio, 2),
        overruns=f"{ours} (bare {bare}) of {sum(slot.cycles for slot in found.servo)}",
        work_p99_us=round(found.work_p99_us),
    )
    if condition.priority and condition.spin_us == SPIN_US:
        assert found.p99_ratio <= 1.5
        assert ours <= 2 * bare + 5
        assert found.work_p99_us <= 100.0


def test_the_daemon_is_soon_healthy_and_small(tmp_path):
    daemon = DaemonProcess(tmp_path)
    environment = {**os.environ, "XDG_STATE_HOME": str(tmp_path)}
    times = []
    for _ in range(5):
        began = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "orientd", "run", "--config", str(daemon.config)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
        )
        with grpc.insecure_channel(f"unix:{daemon.socket}", options=EAGER) as channel:
            check = health(channel).Check
            answer = check(HealthCheckRequest(), wait_for_ready=True, timeout=10.0)
            times.append(round(time.monotonic() - began, 3))
            assert answer.status == HealthCheckResponse.SERVING
        process.stdout.readline()
        resident = resident_kib(process.pid) / 1024
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
        process.stdout.close()
    with DaemonProcess(tmp_path) as daemon:
        for _ in daemon.move(spin(2.0)):
            pass
        servo = resident_kib(daemon.device().servo_pid) / 1024
    show("start", health_s=times, daemon_mib=round(resident, 1), servo_mib=round(servo, 1))
    assert sorted(times)[2] <= 1.0
    assert resident <= 80.0
    assert servo <= 30.0


def test_a_killed_servo_is_told_soon(tmp_path):
    times = []
    for _ in range(10):
        with DaemonProcess(tmp_path) as daemon:
            stream = daemon.move(spin(3.0))
            servo = daemon.device().servo_pid
            time.sleep(0.3)
            began = time.monotonic()
            os.kill(servo, signal.SIGKILL)
            while daemon.device().state != pb.STATE_FAULT:
                pass
            times.append(round((time.monotonic() - began) * 1e3, 1))
            *_, last = stream
            assert last.summary.outcome == pb.OUTCOME_FAULT
            assert daemon.device().name == DEVICE
    show("a killed servo is told after", ms=times)
    assert max(times) <= 100.0
