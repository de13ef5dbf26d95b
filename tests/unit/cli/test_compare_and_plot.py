"""The commands that compare families and draw them, inside this process."""

import json
from pathlib import Path

import pytest
from command_line import assert_refused, inside

from orientd.curves import METHODS, comparison

STANDARD = Path(__file__).parents[2] / "data/standard"
QUICK = ("squad", "c2_cumulative", "piecewise_slerp", "kks_bspline", "slerp")


@pytest.fixture(autouse=True)
def _few_families(monkeypatch):
    """All of them are compared elsewhere."""
    few = {name: METHODS[name] for name in QUICK}
    whole = comparison.compare
    monkeypatch.setattr(
        comparison, "compare", lambda task, **more: whole(task, **{**more, "families": few})
    )


def told(*arguments):
    done = inside(*arguments, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_families_are_compared_as_a_table():
    done = inside("compare", STANDARD / "fly_through.yaml")
    assert done.returncode == 0
    header, *rows = done.stdout.split("\n\n")[0].splitlines()
    assert header.split()[:3] == ["method", "keyframes", "smooth"]
    assert "torque" not in header
    assert [row.split()[0] for row in rows] == [
        "c2_cumulative",
        "squad",
        "piecewise_slerp",
        "kks_bspline",
    ]
    assert "the velocity jumps there" in done.stdout
    assert "slerp" in done.stdout.splitlines()[-1]
    assert "takes exactly 2 keyframes, got 8" in done.stdout.splitlines()[-1]


def test_families_are_compared_for_a_program():
    report = told(
        "compare", STANDARD / "fly_through.yaml", "--inertia", "1,2,3", "--ends", "natural"
    )
    families = {family["name"]: family for family in report["families"]}
    assert set(families) == set(QUICK)
    best = families["c2_cumulative"]
    assert best["applies"]
    assert best["interpolates"]
    assert best["continuity"] == 2
    assert best["end_velocity_error"] < 1e-9
    published = dict(
        zip(
            (STANDARD / "fly_through.csv").read_text().splitlines()[0].split(","),
            next(
                line.split(",")
                for line in (STANDARD / "fly_through.csv").read_text().splitlines()
                if line.startswith("c2_cumulative")
            ),
            strict=True,
        )
    )
    for name in ("effort", "torque_effort", "peak_velocity", "peak_acceleration", "path_length"):
        assert best[name] == pytest.approx(float(published[name]), rel=1e-5)
    assert best["build_time"] > 0.0
    assert families["slerp"] == {
        "name": "slerp",
        "applies": False,
        "why_not": "takes exactly 2 keyframes, got 8",
    }


def test_the_table_is_sorted_as_asked():
    def order(column):
        file = STANDARD / "spread.yaml"
        families = told("compare", file, "--sort", column, "--ends", "natural")["families"]
        return [family["name"] for family in families]

    assert order("name") == sorted(QUICK)
    assert order("length")[0] == "piecewise_slerp"
    assert order("effort")[0] == "c2_cumulative"


def test_times_can_be_uniform_or_by_chord():
    file = STANDARD / "clustered.yaml"
    assert told("compare", file, "--times", "uniform")["times"] == list(range(12))
    chord = told("compare", file, "--times", "chord")["times"]
    # Half of 4 degrees and half of 70 degrees, in radians.
    assert chord[1] == pytest.approx(0.0349066, rel=1e-5)
    assert chord[3] - chord[2] == pytest.approx(0.610865, rel=1e-5)


def test_a_file_without_times_is_taken_by_chord():
    times = told("compare", STANDARD / "ideal_samples.yaml")["times"]
    chord = told("compare", STANDARD / "ideal_samples.yaml", "--times", "chord")["times"]
    assert times == pytest.approx(chord, rel=1e-14)


def test_options_of_the_file_go_to_its_method(tmp_path):
    file = tmp_path / "open.yaml"
    text = (STANDARD / "fly_through.yaml").read_text()
    without_velocities = "\n".join(line for line in text.splitlines() if "velocity" not in line)
    file.write_text(f"method: kks_bspline\noptions: {{order: 3}}\n{without_velocities}\n")
    families = {one["name"]: one for one in told("compare", file)["families"]}
    assert families["kks_bspline"]["continuity"] == 1


@pytest.mark.parametrize("show", ["motion", "triads", "rates", "body"])
def test_a_motion_file_is_drawn(tmp_path, show):
    pytest.importorskip("matplotlib")
    path = tmp_path / "camera.svg"
    report = told("plot", STANDARD / "fly_through.yaml", "--show", show, "-o", path)
    assert report["plot"] == str(path)
    text = path.read_text()
    assert ("trace-x" in text) == (show in ("motion", "triads"))
    assert ("component-x" in text) == (show in ("motion", "rates"))
    assert ("faces" in text) == (show == "body")


def test_a_family_that_cannot_join_the_keyframes_says_so(tmp_path):
    pytest.importorskip("matplotlib")
    file = tmp_path / "shieh.yaml"
    file.write_text("method: nielson_shieh\n" + (STANDARD / "nearly_identical.yaml").read_text())
    done = inside("plot", file, "-o", tmp_path / "x.svg")
    assert_refused(done, "nielson_shieh cannot join these keyframes")
