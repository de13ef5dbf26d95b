"""`compare`, `plot`, `plan` and `move` make the same curve of the same motion file."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from motions import read

from orientd import motion_file, plots
from orientd.cli.main import app
from orientd.curves import METHODS, comparison, is_pair
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.planning import plan as planned
from orientd.planner.state import State
from orientd.rotation import angle

KEYFRAMES = """
keyframes:
  - {time: 1.0, quaternion: {w: 1, x: 0, y: 0, z: 0}}
  - {time: 2.0, rotation_vector: [0.1, 0.2, 0.3]}
  - {time: 3.0, rotation_vector: [0.3, 0.2, 0.5]}
  - {time: 4.0, rotation_vector: [0.4, 0.3, 0.8]}
  - {time: 5.0, rotation_vector: [0.4, 0.5, 0.9]}
"""
VELOCITIES = "start_velocity: [0, 0, 0.1]\nend_velocity: [0.1, 0, 0.1]\n"
PERIOD = 0.002
ROUGH = {"piecewise_slerp", "circular_blending"}  # C0 only: compared and drawn, never planned
CASES = [
    *((name, "") for name in METHODS if name not in ROUGH),
    *((name, VELOCITIES) for name in METHODS if METHODS[name].meets_end_velocities),
]


@pytest.fixture
def made(monkeypatch):
    """The curves that `compare` and `plot` make, by command, and what `plot` would draw."""
    found = {}
    compared, traced = comparison.compare, plots.traces_of

    def keep_compared(task, **more):
        candidates = compared(task, **{**more, "families": {found["name"]: found["family"]}})
        found["compare"] = candidates[0]
        return candidates

    def keep_traced(curve, task, **more):
        found["plot"] = curve
        return traced(curve, task, **more)

    monkeypatch.setattr(comparison, "compare", keep_compared)

    def keep_drawn(path, traces, **more):
        # Pictures are drawn elsewhere, and take ten times as long as all else here.
        found["drawn"] = traces

    monkeypatch.setattr(plots, "traces_of", keep_traced)
    monkeypatch.setattr(plots, "draw_traces", keep_drawn)
    return found


def run(*arguments):
    done = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def assert_is_drawn(made):
    traces, curve = made["drawn"], made["plot"]
    assert np.ptp(traces.times) == pytest.approx(np.ptp(curve.domain), rel=1e-9)
    assert angle(curve.evaluate(traces.times)[0], traces.q).max() < 1e-9


@pytest.mark.parametrize(("name", "velocities"), CASES)
def test_four_commands_make_one_curve(name, velocities, made, tmp_path):
    pytest.importorskip("matplotlib")
    file, samples = tmp_path / "motion.yaml", tmp_path / "motion.npz"
    keyframes = "\n".join(KEYFRAMES.splitlines()[: 4 if is_pair(METHODS[name]) else None])
    options = "options: {require_positive: false}\n" if name == "nielson_shieh" else ""
    file.write_text(f"method: {name}\napproach: true\n{options}{velocities}{keyframes}\n")
    made.update(name=name, family=METHODS[name])
    run("compare", file)
    run("plot", file, "-o", tmp_path / "motion.svg")
    planned_as = run("plan", file, "-o", samples)["plan"]
    request = motion_file.load(file)
    # What the daemon plans has been over the wire.
    received = read(request)
    start = State.at_rest(request.keys[0])
    moved = planned(received, start=start, limits=DEFAULT_LIMITS, period=PERIOD)

    first, last = request.times[[0, -1]]
    with np.load(samples) as archive:
        times, q = archive["time"], archive["q_wxyz"]
    lead_in = planned_as["certificate"]["lead_in"]
    is_inside = (times >= lead_in) & (times <= lead_in + last - first)
    instants = np.clip(first + times[is_inside] - lead_in, first, last)
    assert is_inside.sum() > 400
    drawn = {"compare": made["compare"].curve, "plot": made["plot"]}
    for command, curve in drawn.items():
        assert angle(curve.evaluate(instants)[0], q[is_inside]).max() < 1e-9, command
    again = moved.sample(moved.start_time + instants - first).q
    assert angle(again, q[is_inside]).max() < 1e-9
    assert drawn["compare"] == drawn["plot"]
    assert_is_drawn(made)


@pytest.mark.parametrize("name", ["c2_cumulative", "kks_bspline", "kks_uniform", "squad"])
def test_without_times_it_is_the_same_curve_at_another_pace(name, made, tmp_path):
    pytest.importorskip("matplotlib")
    file = tmp_path / "motion.yaml"
    file.write_text(
        f"method: {name}\napproach: true\npace: even\nkeyframes:\n"
        + "\n".join(f"  - {{rotation_vector: [0.2, {0.1 * k * k}, {0.4 * k}]}}" for k in range(5))
        # Whoever passes through keyframes passes one that is repeated once.
        + ("\n  - {rotation_vector: [0.2, 1.6, 1.6]}\n" if METHODS[name].interpolates else "")
    )
    made.update(name=name, family=METHODS[name])
    run("compare", file)
    run("plot", file, "-o", tmp_path / "motion.svg")
    request = motion_file.load(file)
    start = State.at_rest(request.keys[0])
    motion = planned(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)
    share = np.linspace(0.0, 1.0, 301)
    core = motion.sample(motion.start_time + share * (motion.end_time - motion.start_time)).q
    for curve in (made["compare"].curve, made["plot"]):
        begin, end = curve.domain
        assert angle(curve.evaluate(begin + share * (end - begin))[0], core).max() < 1e-9
    assert_is_drawn(made)
