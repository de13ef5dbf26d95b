"""Time from a command in the shell to the servo's first braking cycle.

    python -m pytest tests/bench/test_commands.py -m bench -s

The same run measures the time to load gRPC's library alone.
"""

import statistics
import subprocess
import sys
import time

import pytest
from command_line import COMMAND, environment
from harness import DaemonProcess, spin
from test_servo import show

import orientd
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.bench

ROUNDS = 15
NS = 1_000_000_000


def braking_time_ns(robot, since_ns):
    """Return when the first cycle after *since_ns* began whose path rate is less than full."""
    for cycles in robot.watch(rate_hz=50.0):
        for cycle in cycles:
            if cycle.deadline_ns > since_ns and cycle.speed < 1.0:
                return cycle.deadline_ns + cycle.lateness_ns
    raise AssertionError("the daemon was lost")


def until_full_speed(robot):
    for cycles in robot.watch(rate_hz=50.0):
        if cycles and cycles[-1].speed == 1.0:
            return


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["stop", "halt"])
def test_a_device_brakes_soon_after_the_command_was_typed(tmp_path, name):
    taken, loading = [], []
    daemon = DaemonProcess(tmp_path, lease=600.0)
    with daemon, orientd.connect(daemon.socket) as robot:
        there = environment(ORIENTD_SOCKET=str(daemon.socket))
        for _ in range(ROUNDS):
            stream = daemon.move(spin(20.0))
            until_full_speed(robot)
            began = time.monotonic_ns()
            process = subprocess.Popen([*COMMAND, name], env=there, stdout=subprocess.DEVNULL)
            braking = braking_time_ns(robot, began)
            assert process.wait(20.0) == 0
            taken.append(braking - began)
            *_, last = stream
            assert last.summary.outcome == pb.OUTCOME_STOPPED
            began = time.monotonic_ns()
            subprocess.run([sys.executable, "-c", "import grpc"], env=there, check=True)
            loading.append(time.monotonic_ns() - began)
    ratio = statistics.median(taken) / statistics.median(loading)
    show(
        f"orientd {name} to the first braking cycle",
        ms=sorted(round(1e3 * part / NS) for part in taken),
        median_ms=round(1e3 * statistics.median(taken) / NS),
        import_grpc_ms=round(1e3 * statistics.median(loading) / NS),
        ratio=round(ratio, 2),
    )
    assert statistics.median(taken) <= 0.15 * NS
    assert ratio <= 1.0
