"""The report of `orientd bench`."""

import json

import pytest
from click.testing import CliRunner

from orientd.bench import PARTS, Comparison, CurveSpeed, curves, retarget, servo
from orientd.bench.curves import Building, Sampling
from orientd.bench.lateness import Slot
from orientd.bench.retarget import Part, RetargetLatency
from orientd.cli.main import app
from orientd.errors import OrientdError

SPEED = CurveSpeed(
    keyframes=100,
    samplings=(Sampling(500, 40.0, 80.0, 1600.0), Sampling(100_000, 10.0, 50.0, 1250.0)),
    buildings=(Building(1.0, 1000, 0.02, 2.0),),
)


def slot(p99_us, work_us=float("nan")):
    return Slot(5000, 20.0, p99_us, 100.0, 200.0, 1, 0, work_us)


def latency(keyframes, count):
    parts = {name: Part(0.001 * (k + 1), 0.0105) for k, name in enumerate(PARTS)}
    return RetargetLatency(keyframes, count, 3, parts)


@pytest.fixture(autouse=True)
def _measured(monkeypatch):
    def compare(condition, *, slots, seconds):
        if not condition.priority:
            raise OrientdError("not permitted here")
        ours, bare = (slot(60.0, 50.0),) * slots, (slot(40.0),) * slots
        return Comparison(ours, bare)

    monkeypatch.setattr(curves, "measure_curves", lambda **_: SPEED)
    monkeypatch.setattr(servo, "compare", compare)
    monkeypatch.setattr(
        retarget,
        "measure_retargets",
        lambda keyframes, *, count, **_: [latency(some, count) for some in keyframes],
    )


def test_people_get_tables():
    result = CliRunner().invoke(app, ["bench"])
    assert result.exit_code == 0
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["500", "40", "(40", "x)", "80", "1600"] in lines
    assert ["100000", "10", "(125", "x)", "50", "1250"] in lines
    for spin in ("50", "0"):
        figures = [spin, "20.0", "60.0", "40", "3", "(C", "3)", "50"]
        assert ["500", "busy", "FIFO", "80", *figures] in lines
    assert any("not permitted here" in " ".join(line) for line in lines)
    assert "100 times the time" in result.stdout


def test_programs_get_one_object():
    result = CliRunner().invoke(app, ["bench", "--json"])
    found = json.loads(result.stdout)
    assert found["curves"]["samplings"][0]["sorted_ns"] == 40.0
    assert found["servo"][0]["p99_ratio"] == 1.5
    assert found["servo"][0]["bare"][0]["work_p99_us"] is None
    assert [one["spin_us"] for one in found["servo"][:3]] == [50, 0, 50]
    assert {"rate_hz", "load", "error"} <= set(found["servo"][2])


def test_either_part_can_be_left_out():
    found = json.loads(CliRunner().invoke(app, ["bench", "--json", "--no-servo"]).stdout)
    assert found["servo"] is None
    found = json.loads(CliRunner().invoke(app, ["bench", "--json", "--no-curves"]).stdout)
    assert found["curves"] is None


def test_retargets_are_taken_apart():
    result = CliRunner().invoke(app, ["bench", "retarget", "--count", "50"])
    header, *rows = [line.split() for line in result.stdout.splitlines()[1:]]
    assert header == ["keyframes", "count", "replanned", *PARTS]
    assert [row[:6] for row in rows] == [
        ["1", "50", "3", "1.00", "/", "10.50"],
        ["20", "50", "3", "1.00", "/", "10.50"],
    ]
    result = CliRunner().invoke(app, ["bench", "retarget", "--keyframes", "5", "--json"])
    (one,) = json.loads(result.stdout)["retargets"]
    assert one["keyframes"] == 5
    assert one["parts"]["total"] == {"p50": 0.005, "p99": 0.0105}
