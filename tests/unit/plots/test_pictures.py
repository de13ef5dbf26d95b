"""Pictures have in them what they are said to show.

Elements are found by their ids in the SVG; no pixels are compared.
"""

import re

import numpy as np
import pytest

from orientd.curves import METHODS, CurveTask, compare, make_curve, ranked
from orientd.planner import Limits
from orientd.rotation import exp, from_euler

pytest.importorskip("matplotlib")

from orientd import plots
from orientd.plots.bodies import SweptPoses, draw_bodies, plate
from orientd.plots.paper import new_figure
from orientd.plots.recording import _mark
from orientd.plots.sampling import traces_of
from orientd.plots.triads import draw_triads
from orientd.plots.view import Viewpoint

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


def test_what_is_behind_the_sphere_is_drawn_as_hidden():
    axes = new_figure(3.0, 3.0).subplots()
    view = Viewpoint(elevation=0.0, azimuth=0.0)
    # About the upright axis the x tip turns from the front to the back.
    q = exp(np.outer(np.linspace(0.0, np.pi, 200), [0.0, 0.0, 1.0]))
    draw_triads(axes, q, q[[0, -1]], style=plots.triads.TriadStyle(view=view))
    lines = {line.get_gid(): line for line in axes.get_lines()}
    front = lines["trace-x"].get_xydata()
    hidden = lines["hidden-x"].get_xydata()
    # Both halves of the way have the same points on the sheet; each is drawn once.
    assert np.isfinite(front[:, 0]).sum() == pytest.approx(len(front) / 2, abs=2)
    assert np.isfinite(hidden[:, 0]).sum() == pytest.approx(len(hidden) / 2, abs=2)
    assert lines["hidden-x"].get_linewidth() < lines["trace-x"].get_linewidth()


def test_numbers_do_not_cover_each_other():
    q = exp(np.cumsum(np.tile([0.05, 0.1, 0.15], (12, 1)), axis=0))
    axes = new_figure(7.0, 7.0).subplots()
    draw_triads(axes, q, q)
    texts = [text for text in axes.texts if (text.get_gid() or "").startswith("number-")]
    places = np.array([text.get_position() for text in texts])
    apart = np.linalg.norm(places[:, None] - places[None, :], axis=-1)
    assert apart[~np.eye(len(places), dtype=bool)].min() > 0.03


def test_a_sheet_shows_who_applies_and_says_who_does_not(tmp_path):
    families = {name: METHODS[name] for name in ("squad", "c2_cumulative", "kks_bspline", "slerp")}
    candidates = ranked(compare(TASK, families=families))
    text = svg(plots.draw_sheet, tmp_path, TASK, candidates, title="families")
    assert {"family-squad", "family-c2_cumulative", "family-kks_bspline"} <= ids(text)
    assert "family-slerp" not in ids(text)
    assert "not drawn: slerp (takes exactly 2 keyframes, got 6)" in text


def test_a_body_is_drawn_at_every_pose_and_dark_at_the_keyframes():
    axes = new_figure(3.0, 3.0).subplots()
    positions = np.outer(np.arange(16.0), [1.0, 0.3, 0.1])
    poses = SweptPoses(positions, np.resize(TASK.keys, (16, 4)))
    between, keyframes = (
        SweptPoses(poses.positions[of], poses.q[of]) for of in (slice(10), slice(10, 16))
    )
    faces = plate()
    draw_bodies(axes, faces, between, keyframes, Viewpoint(), positions)
    (painted,) = (part for part in axes.collections if part.get_gid() == "faces")
    assert len(painted.get_paths()) == len(faces) * (10 + 6)
    lightness = painted.get_facecolor()[:, :3].mean(axis=1)
    assert (lightness < 0.32).sum() == len(faces) * 6


def test_names_of_events_at_one_moment_stand_side_by_side():
    axes = new_figure(4.0, 3.0, "").subplots()
    _mark(axes, [(1.0, "FAULT"), (1.0, "stopped"), (5.0, "started")], 10.0, is_named=True)
    places = [text.xy[0] for text in axes.texts]
    assert np.all(np.diff(places) > 0.1)
    assert places[2] == 5.0
