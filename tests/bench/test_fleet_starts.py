"""Starts of a cell, many of them: with one unable, with whoever asks killed."""

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from fleet_cell import CELL, RunningCell
from harness import until

import orientd
from orientd.errors import StateError
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd_fleet import FleetMotion, move_together

pytest.importorskip("zenoh")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(1200)]

SHARE = float(os.environ.get("ORIENTD_BENCH_SHARE", "1"))
"""Of the rounds that are to be run."""

LATEST_NS = 50_000_000
"""Who is killed later than so long before the start has started it."""


def turn(angle):
    return parse({"keyframes": [{"rotation_vector": [0.0, 0.0, angle]}], "approach": True})


def rounds(number):
    return max(1, round(number * SHARE))


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(prefix="orientd-") as name:
        yield Path(name)


def reports(cell):
    found = {}
    for name in cell.names:
        with orientd.connect(cell.control(name)) as robot:
            found[name] = robot.state()
    return found


def poses(cell):
    return {
        f"{name} {axis}": part
        for name, one in reports(cell).items()
        for axis, part in zip("wxyz", to_quaternion(one.devices["arm"].cycle.q), strict=True)
    }


def are_at_rest(cell):
    return all(
        one.devices["arm"].state in (pb.STATE_HOLDING, pb.STATE_IDLE) and not one.daemon.leases
        for one in reports(cell).values()
    )


def test_with_one_unable_none_moves(folder, capsys):
    with RunningCell(folder, 4) as cell, cell.fleet() as fleet:
        before, chance = poses(cell), random.Random(2)
        for _ in range(rounds(50)):
            unable = chance.choice(cell.names)
            with orientd.connect(cell.control(unable)) as robot:
                robot.disable()
            with pytest.raises(StateError):
                move_together(fleet, [FleetMotion(name, "", turn(0.5)) for name in cell.names])
            with orientd.connect(cell.control(unable)) as robot:
                robot.enable()
            assert poses(cell) == pytest.approx(before, abs=1e-9)
    with capsys.disabled():
        print(f"\none unable: none moved, {rounds(50)} of {rounds(50)}")


ASKER = """
import sys
from orientd_fleet import FleetMotion, connect_fleet, move_together, together
from orientd.motion_file import parse
starts = together._starts
def told(*given):
    found = starts(*given)
    print(found[1], flush=True)
    return found
together._starts = told
endpoint, cell, *names = sys.argv[1:]
fleet = connect_fleet(endpoint, cell=cell, wait_for=names)
request = parse({"keyframes": [{"rotation_vector": [0, 0, 0.9]}], "approach": True})
print("begin", flush=True)
move_together(fleet, [FleetMotion(name, "", request) for name in names], start_in=0.7)
"""


def test_whoever_asks_is_killed_at_any_moment(folder, capsys):
    """Nothing begins that was not started, and no lease stays for longer than its time."""
    chance, began, prevented, longest = random.Random(3), 0, 0, 0.0
    lease = 1.0
    with RunningCell(folder, 3, lease=lease) as cell:
        for _ in range(rounds(50)):
            before = poses(cell)
            arguments = [cell.endpoint, CELL, *cell.names]
            with subprocess.Popen(
                [sys.executable, "-c", ASKER, *arguments], stdout=subprocess.PIPE, text=True
            ) as asker:
                assert asker.stdout.readline().startswith("begin")
                time.sleep(chance.uniform(0.0, 1.3))
                asker.kill()
                killed_ns = time.monotonic_ns()
                said = asker.stdout.read().split()
            until(lambda: are_at_rest(cell), "leases run out", 30.0)
            longest = max(longest, (time.monotonic_ns() - killed_ns) * 1e-9)
            if said and killed_ns > int(said[0]) - LATEST_NS:
                began += 1
            else:
                prevented += 1
                assert poses(cell) == pytest.approx(before, abs=1e-9)
    with capsys.disabled():
        print(
            f"\nkilled {began + prevented} times: {prevented} before the start, none moved; "
            f"at rest and free within {longest:.2f} s, the lease lasts {lease:g} s"
        )
