"""What `orientd bench` tells of what was measured."""

import json

import pytest
from typer.testing import CliRunner

from orientd.bench import curves, servo
from orientd.bench.curves import Building, CurveSpeed, Sampling
from orientd.bench.lateness import Slot
from orientd.bench.servo import Comparison
from orientd.cli.main import app
from orientd.errors import OrientdError

SPEED = CurveSpeed(
    keyframes=100,
    samplings=(Sampling(500, 40.0, 400.0, 1600.0), Sampling(100_000, None, 250.0, 1250.0)),
    buildings=(Building(1.0, 1000, 0.02, 2.0),),
)


def slot(p99_us, work_us=float("nan")):
    return Slot(5000, 20.0, p99_us, 100.0, 200.0, 1, 0, work_us)


@pytest.fixture(autouse=True)
def _measured(monkeypatch):
    def compare(*, rate_hz, is_loaded, priority, slots, seconds):
        if not priority:
            raise OrientdError("not permitted here")
        ours, bare = (slot(60.0, 50.0),) * slots, (slot(40.0),) * slots
        return Comparison(rate_hz, is_loaded, priority, ours, bare)

    monkeypatch.setattr(curves, "measure_curves", lambda **_: SPEED)
    monkeypatch.setattr(servo, "compare", compare)


def test_people_get_tables():
    result = CliRunner().invoke(app, ["bench"])
    assert result.exit_code == 0
    lines = [line.split() for line in result.stdout.splitlines()]
    assert ["500", "40", "(40", "x)", "400", "(4", "x)", "1600"] in lines
    assert ["100000", "not", "installed", "250", "(5", "x)", "1250"] in lines
    assert ["500", "busy", "FIFO", "80", "20", "60", "40", "3", "(C", "3)", "50"] in lines
    assert any("not permitted here" in " ".join(line) for line in lines)
    assert "100 times the time" in result.stdout


def test_programs_get_one_object():
    result = CliRunner().invoke(app, ["bench", "--json"])
    found = json.loads(result.stdout)
    assert found["curves"]["samplings"][0]["compiled_ns"] == 40.0
    assert found["servo"][0]["p99_ratio"] == 1.5
    assert found["servo"][0]["bare"][0]["work_p99_us"] is None
    assert {"rate_hz", "load", "error"} <= set(found["servo"][1])


def test_either_part_can_be_left_out():
    found = json.loads(CliRunner().invoke(app, ["bench", "--json", "--no-servo"]).stdout)
    assert found["servo"] is None
    found = json.loads(CliRunner().invoke(app, ["bench", "--json", "--no-curves"]).stdout)
    assert found["curves"] is None
