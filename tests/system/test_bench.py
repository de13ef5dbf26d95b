"""`orientd bench`: five durations, and a device that does not do what it should."""

import json

import pytest
from command_line import assert_refused, inside

from orientd.cli.commands import bench
from orientd.client.robot import Robot

QUICK = ("bench", "--seconds", "0.5", "--count", "2")
KINDS = ("lateness", "plan", "retarget", "start", "stop")


@pytest.fixture(scope="module")
def measured():
    done = inside(*QUICK, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("kind", KINDS)
def test_a_duration_has_a_count_a_median_and_a_worst_value(measured, kind):
    times = measured[kind]
    assert set(times) == {"count", "median", "worst"}
    assert times["count"] == 2 if kind != "lateness" else times["count"] > 200
    assert 0.0 < times["median"] <= times["worst"] < 30.0


def test_what_is_measured_is_named(measured):
    assert set(measured) == {"scheduling", *KINDS}
    # A stop goes to the servo at once; a retarget is planned first.
    assert measured["stop"]["median"] < measured["retarget"]["median"]


def test_people_get_a_table(monkeypatch):
    monkeypatch.setattr(bench, "_start", lambda: 0.25)
    monkeypatch.setattr(bench, "_plan", lambda *_: 0.002)
    monkeypatch.setattr(bench, "_retarget", lambda *_: 0.0125)
    monkeypatch.setattr(bench, "_stop", lambda *_: 0.0005)
    done = inside(*QUICK)
    assert done.returncode == 0, done.stderr
    first, header, lateness, *rows = done.stdout.splitlines()
    assert first.startswith("servo: SCHED_")
    assert header.split("  ")[-2:] == ["median, ms", "worst, ms"]
    assert lateness.split()[0] == "lateness"
    assert [row.split() for row in rows] == [
        ["plan", "2", "2.000", "2.000"],
        ["retarget", "2", "12.500", "12.500"],
        ["start", "2", "250.000", "250.000"],
        ["stop", "2", "0.500", "0.500"],
    ]


@pytest.mark.parametrize("old", ["retarget", "--no-curves", "--slots"])
def test_an_earlier_spelling_names_what_serves_instead(old):
    done = inside("bench", old, "--count", "5")
    assert_refused(done, f"unexpected {old!r}", "`make bench`", status=2)


@pytest.mark.parametrize("motions", [0, 3, 6])
def test_a_device_that_faults_is_one_line(monkeypatch, tmp_path, motions):
    """Before the first motion, amid the retargets, and in the last motion, which is stopped."""
    path, begun, move = tmp_path / "fault", [], Robot.move
    options = f"[devices.arm.options]\nfault_file = {json.dumps(str(path))}\n"
    monkeypatch.setattr(bench, "DEVICE", f"{bench.DEVICE}{options}")
    monkeypatch.setattr(bench, "_start", lambda: 0.25)

    def move_and_fault(*arguments, **fields):
        begun.append(move(*arguments, **fields))
        if len(begun) == motions:
            path.write_text("device_fault")
        return begun[-1]

    monkeypatch.setattr(Robot, "move", move_and_fault)
    if not motions:
        path.write_text("device_fault")
    done = inside(*QUICK)
    assert_refused(done, "injected fault: device_fault")
    assert len(begun) == motions
