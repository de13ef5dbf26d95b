"""Pictures have in them what they are said to show.

Elements are found by their ids in the SVG; no pixels are compared.
"""

import re

import numpy as np
import pytest

from orientd.curves import METHODS, CurveTask, make_curve
from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import from_euler

pytest.importorskip("matplotlib")

from orientd import plots
from orientd.plots.paper import new_figure
from orientd.plots.recording import _mark
from orientd.plots.sampling import traces_of

DEGREES = [[0, 0, 0], [35, -25, 20], [80, -30, 10], [120, 5, -30], [130, 45, -75], [165, 60, -140]]
TASK = CurveTask(from_euler("ZYX", np.radians(DEGREES)), np.arange(6.0))
BEGINNINGS = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}


def traces(name="c2_cumulative", task=TASK, **more):
    return traces_of(make_curve(METHODS[name], task), task, **more)


def svg(draw, tmp_path, *arguments, **options):
    path = tmp_path / "picture.svg"
    draw(path, *arguments, **options)
    return path.read_text(encoding="utf-8")


def ids(text):
    return set(re.findall(r'id="([^"]+)"', text))


@pytest.mark.parametrize("ending", BEGINNINGS)
def test_the_ending_names_the_format(tmp_path, ending):
    path = tmp_path / f"picture.{ending}"
    plots.draw_traces(path, traces(), title="curve")
    assert path.read_bytes().startswith(BEGINNINGS[ending])


def test_a_triad_graph_has_three_traces_their_hidden_halves_and_numbers(tmp_path):
    found = ids(svg(plots.draw_traces, tmp_path, traces(), title="curve"))
    for axis in "xyz":
        assert {f"trace-{axis}", f"hidden-{axis}", f"keyframes-{axis}"} <= found
        # The letter leads the first number.
        assert any(one.startswith(f"number-{axis}-{axis}1") for one in found)
        assert f"component-{axis}" in found
    written = " ".join(one for one in found if one.startswith("number-"))
    assert set("123456") <= set(written)


def test_limits_are_drawn_where_the_curve_comes_near_and_told_where_not(tmp_path):
    limits = Limits.partial(velocity=2.0, acceleration=500.0)
    text = svg(plots.draw_traces, tmp_path, traces(limits=limits), title="curve")
    assert "limit 2 rad/s" in text
    assert "limit 500 rad/s²" in text
    assert len(re.findall(r'id="limit"', text)) == 1


def test_the_same_picture_is_the_same_file(tmp_path):
    one = svg(plots.draw_traces, tmp_path, traces(), title="curve")
    assert one == svg(plots.draw_traces, tmp_path, traces(), title="curve")


def test_lines_are_interrupted_where_a_derivative_jumps():
    drawn = traces("piecewise_slerp")
    times, omega = plots.charts.interrupted(drawn.times, drawn.omega_body, drawn.breaks)
    gaps = np.isnan(omega).all(axis=1)
    assert gaps.sum() == len(TASK.times) - 2
    assert times[gaps] == pytest.approx(TASK.times[1:-1])


def test_names_of_events_at_one_moment_stand_side_by_side():
    axes = new_figure(4.0, 3.0, "").subplots()
    _mark(axes, [(1.0, "FAULT"), (1.0, "stopped"), (5.0, "started")], 10.0, is_named=True)
    places = [text.xy[0] for text in axes.texts]
    assert np.all(np.diff(places) > 0.1)
    assert places[2] == 5.0


def test_plot_of_a_motion_names_the_function_that_draws_it(tmp_path):
    start, request = State.at_rest((1, 0, 0, 0)), MotionRequest([Keyframe((0.8, 0.6, 0, 0))])
    motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)
    with pytest.raises(OrientdError, match=r"orientd\.plots\.draw\(motion, path\)"):
        motion.plot(tmp_path / "motion.png")
