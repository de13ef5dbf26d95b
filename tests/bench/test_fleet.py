"""A cell: stops, starts, what 64 daemons take, links that lose packets, askers that are killed."""

import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from fleet_cell import CELL, RunningCell, gateway_of
from harness import until
from lossy_network import HERE, LossyNetwork, is_possible

import orientd
from orientd.errors import StateError
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.servo.realtime import set_scheduling
from orientd_fleet.command import STOP_PRIORITY
from orientd_fleet.together import FleetMotion, move_together

pytest.importorskip("zenoh")
pytestmark = [pytest.mark.bench, pytest.mark.timeout(1200)]

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


SHARE = float(os.environ.get("ORIENTD_BENCH_SHARE", "1"))
"""Of the rounds that are to be run."""

LATEST_NS = 50_000_000
"""Who is killed later than so long before the start has started it."""


def rounds(number):
    return max(1, round(number * SHARE))


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


KILLED_ASKER = """
import sys
from orientd_fleet.together import FleetMotion, move_together
from orientd_fleet.client import connect_fleet
from orientd_fleet import together
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
                [sys.executable, "-c", KILLED_ASKER, *arguments], stdout=subprocess.PIPE, text=True
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


needs_namespaces = pytest.mark.skipif(not is_possible(), reason="namespaces are for root")

ROUNDS = int(os.environ.get("ORIENTD_BENCH_ROUNDS", "100"))
LEASE, LINK = 3.0, 3.0
"""How long a lease lasts, and after how long without a sign of life Zenoh gives a link up, s."""

ASKER = """
import json, sys, time
from orientd_fleet.together import FleetMotion, move_together
from orientd_fleet.client import connect_fleet
from orientd.motion_file import parse
from orientd.protocol import control_pb2 as pb
endpoint, cell, certificate, key, ca, rounds, angle, velocity, *names = sys.argv[1:]
with connect_fleet(endpoint, cell=cell, certificate=certificate, key=key, ca=ca, wait_for=names,
                   timeout=30.0) as fleet:
    for number in range(int(rounds)):
        turn = [0, 0, float(angle) * (1 - number % 2)]
        request = parse({"keyframes": [{"rotation_vector": turn}], "approach": True,
                         "limits": {"velocity": float(velocity)}})
        told = []
        def tell(what):
            told.append(what)
            print(json.dumps({"now": what}), flush=True)
        try:
            together = move_together(fleet, [FleetMotion(n, "", request) for n in names], tell=tell)
            now = time.monotonic_ns()
            offsets = [fleet.clock(name).at(now) for name in names]
            wrong = sum(abs(offset.ns) > offset.bound_ns for offset in offsets)
            print(json.dumps({"skew": together.skew, "bound": together.skew_bound, "wrong": wrong,
                              "problem": together.problem,
                              "late": [one.summary.start_lateness for one in together.ended],
                              "again": sum("once more" in one for one in told)}), flush=True)
        except Exception as error:
            print(json.dumps({"problem": str(error)}), flush=True)
"""


def asker(cell, network, rounds, angle, velocity):
    files = cell.files("pendant")
    return subprocess.Popen(
        [
            *network.inside(network.far), sys.executable, "-c", ASKER, cell.router, CELL,
            *map(str, (files["certificate"], files["key"], files["ca"], rounds, angle, velocity)),
            *cell.names,
        ],
        stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def cell_behind(network, folder, daemons):
    inside = network.inside(network.near)
    return RunningCell(folder, daemons, is_tls=True, lease=LEASE, host=HERE, prefix=inside)


def states(cell):
    found = {}
    for name in cell.names:
        with orientd.connect(cell.control(name)) as robot:
            report = robot.state()
            found[name] = (report.devices["arm"].state, bool(report.daemon.leases))
    return found


@needs_namespaces
@pytest.mark.parametrize(("delay", "jitter", "loss"), [(0.02, 0.005, 0.0), (0.01, 0.002, 0.02)])
def test_starts_over_a_link_that_delays_and_loses(folder, capsys, delay, jitter, loss):
    with (
        LossyNetwork(delay=delay, jitter=jitter, loss=loss) as network,
        cell_behind(network, folder, 4) as cell,
        asker(cell, network, ROUNDS, 0.02, 2.0) as asking,
    ):
        told = [json.loads(line) for line in asking.stdout]
    carried, lost = network.carried, network.lost
    ended = [one for one in told if "problem" in one]
    good = [one for one in ended if not one["problem"]]
    skews = [one["skew"] for one in good]
    with capsys.disabled():
        print(
            f"\n{delay * 1e3:g} ms, jitter {jitter * 1e3:g} ms, {lost} of {carried} packets lost: "
            f"{len(good)} of {len(ended)} started; skew p50 {statistics.median(skews) * 1e3:.3f}, "
            f"largest {max(skews) * 1e3:.3f} ms; bound p50 "
            f"{statistics.median(one['bound'] for one in good) * 1e3:.1f} ms; given again "
            f"{sum(one['again'] for one in good)} times"
        )
    assert [one["problem"] for one in ended] == [""] * ROUNDS
    for one in good:
        if one["skew"] > CYCLE:
            late = [round(lateness * 1e3, 3) for lateness in one["late"]]
            print(f"{one['skew'] * 1e3:.3f} ms: began {late} ms late, by bound {one['bound']}")
    assert max(skews) <= CYCLE
    assert not any(one["wrong"] for one in good)


def are_moving(cell):
    return all(state == pb.STATE_STREAMING for state, _ in states(cell).values())


def are_free_and_at_rest(cell):
    return all(
        state == pb.STATE_HOLDING and not is_leased for state, is_leased in states(cell).values()
    )


@needs_namespaces
def test_a_partition_in_the_middle_of_a_motion_stops_it(folder, capsys):
    took = []
    with LossyNetwork(delay=0.002) as network, cell_behind(network, folder, 2) as cell:
        for _ in range(3):
            with asker(cell, network, 1, 3.0, 0.1) as asking:
                while json.loads(asking.stdout.readline()).get("now") != "moving":
                    pass
                until(lambda: are_moving(cell), "they move")
                network.is_cut, began = True, time.monotonic()
                until(lambda: are_free_and_at_rest(cell), "all stop", 30.0)
                took.append(time.monotonic() - began)
                *_, last = (json.loads(line) for line in asking.stdout)
            network.is_cut = False
            assert last["problem"]
    with capsys.disabled():
        print(f"\nlink cut while two move: at rest and free after {[round(t, 2) for t in took]} s")
    assert max(took) < LEASE + LINK + 2.0
