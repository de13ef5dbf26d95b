"""A cell on this machine: how soon all stop, how far apart motions start, what 64 daemons take."""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from fleet_cell import RunningCell, gateway_of

from orientd.motion_file import parse
from orientd.servo.realtime import set_scheduling
from orientd_fleet import FleetMotion, move_together
from orientd_fleet.command import STOP_PRIORITY

pytest.importorskip("zenoh")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]

CYCLE = 2e-3

DAEMONS = int(os.environ.get("ORIENTD_BENCH_DAEMONS", "64"))

HZ = os.sysconf("SC_CLK_TCK")


def turn(angle):
    return parse({"keyframes": [{"rotation_vector": [0.0, 0.0, angle]}], "approach": True})


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(prefix="orientd-") as name:
        yield Path(name)


@pytest.fixture
def urgent():
    """Ask for a stop as the command does: before whatever else runs."""
    set_scheduling(STOP_PRIORITY)
    yield
    for thread in os.listdir("/proc/self/task"):
        os.sched_setscheduler(int(thread), os.SCHED_OTHER, os.sched_param(0))


@pytest.fixture
def busy():
    """Keep every core busy."""
    loops = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count())
    ]
    yield
    for loop in loops:
        loop.kill()
        loop.wait()


def percent(values, share):
    return sorted(values)[min(len(values) - 1, round(share * len(values)))]


def test_the_last_of_16_daemons_brakes_soon(folder, busy, capsys, request):
    """Each acknowledgement says that a servo has taken the stop: it brakes in that cycle."""
    with RunningCell(folder, 16) as cell, cell.fleet() as fleet:
        request.getfixturevalue("urgent")
        last = []
        for name in cell.names:
            fleet.clock(name).measure()
        for _ in range(200):
            told = fleet.stop()
            assert [one.problem for one in told] == [""] * 16
            last.append(max(one.taken_after for one in told))
            time.sleep(0.02)
    with capsys.disabled():
        print(
            f"\nstop of 16 daemons, last servo: p50 {statistics.median(last) * 1e3:.1f} ms, "
            f"p99 {percent(last, 0.99) * 1e3:.1f} ms, largest {max(last) * 1e3:.1f} ms of 200"
        )
    assert statistics.median(last) <= 0.030
    assert max(last) <= 0.100


def test_motions_of_4_daemons_start_within_a_cycle(folder, capsys):
    skews, bounds = [], []
    with RunningCell(folder, 4) as cell, cell.fleet() as fleet:
        for number in range(100):
            request = turn(0.02 * (number % 2))
            together = move_together(fleet, [FleetMotion(name, "", request) for name in cell.names])
            assert together.problem == ""
            skews.append(together.skew)
            bounds.append(together.skew_bound)
            # All clocks are one here: every offset that was found is its error.
            for name in cell.names:
                offset = fleet.clock(name).at(time.monotonic_ns())
                assert abs(offset.ns) <= offset.bound_ns
    with capsys.disabled():
        print(
            f"\nskew of 4 daemons: p50 {statistics.median(skews) * 1e3:.3f} ms, largest "
            f"{max(skews) * 1e3:.3f} ms of 100; bound: p50 {statistics.median(bounds) * 1e3:.3f} "
            f"ms, largest {max(bounds) * 1e3:.3f} ms"
        )
    assert max(skews) <= CYCLE


def used(process):
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / HZ


def gateways(cell):
    return [cell.processes[gateway_of(name)].pid for name in cell.names]


def test_64_daemons_at_10_hz(folder, capsys):
    # By a router, as so many are to be; they take their time to be there on two cores.
    with (
        RunningCell(folder, DAEMONS, is_tls=True, more="rate_hz = 50\n") as cell,
        cell.fleet(timeout=120.0) as fleet,
    ):
        sizes = []
        fleet.subscribe("state", lambda sample: sizes.append(len(sample.payload.to_bytes())))
        time.sleep(10.0)
        watched = gateways(cell)
        assert len(watched) == DAEMONS
        before, began, counted = sum(map(used, watched)), time.monotonic(), len(sizes)
        time.sleep(20.0)
        seconds = time.monotonic() - began
        share = (sum(map(used, watched)) - before) / seconds / DAEMONS
        rate, size = (len(sizes) - counted) / seconds, max(sizes)
        last = []
        for name in cell.names:
            fleet.clock(name).measure(5)
        for _ in range(50):
            told = fleet.stop()
            assert len(told) == DAEMONS
            last.append(max(one.taken_after for one in told))
    with capsys.disabled():
        print(
            f"\n{DAEMONS} daemons: {rate:.0f} states a second of {size} bytes, gateway "
            f"{share:.2%} of a core each; stop: p50 {statistics.median(last) * 1e3:.1f} ms, "
            f"largest {max(last) * 1e3:.1f} ms of 50"
        )
