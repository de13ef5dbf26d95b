"""A cell behind a link that loses packets, and one that is cut in the middle of a motion."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest
from fleet_cell import CELL, RunningCell
from harness import until
from lossy_network import HERE, LossyNetwork, is_possible

import orientd
from orientd.protocol import control_pb2 as pb

pytest.importorskip("zenoh")
pytestmark = [
    pytest.mark.bench,
    pytest.mark.timeout(900),
    pytest.mark.skipif(not is_possible(), reason="namespaces are for root"),
]

ROUNDS = int(os.environ.get("ORIENTD_BENCH_ROUNDS", "100"))
CYCLE = 2e-3
LEASE, LINK = 3.0, 3.0
"""How long a lease lasts, and after how long without a sign of life Zenoh gives a link up, s."""

ASKER = """
import json, sys, time
from orientd_fleet import FleetMotion, connect_fleet, move_together
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


@pytest.fixture
def folder():
    with tempfile.TemporaryDirectory(prefix="orientd-") as name:
        yield Path(name)


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
