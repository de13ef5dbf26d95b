"""The pictures of the methods and of the papers have in them what they are said to show."""

import re
import sys

import numpy as np
import pytest
from pages import DOCS

from orientd.curves import METHODS, make_curve
from orientd.curves.comparison import compare
from orientd.errors import OrientdError
from orientd.rotation import angle, rotate

pytest.importorskip("matplotlib")

from orientd.plots.bodies import SweptPoses
from orientd.plots.paper import new_figure
from orientd.plots.sampling import traces_of
from orientd.plots.view import Viewpoint

sys.path.insert(0, str(DOCS))
from generators import basis, gallery
from generators.papers import page, scenes
from generators.papers.figures import FIGURES, draw_figure
from generators.papers.sweep import draw_sweep


def ids(text):
    return set(re.findall(r'id="([^"]+)"', text))


@pytest.mark.parametrize("name", METHODS)
def test_every_family_does_an_example_of_the_gallery(name):
    task = gallery.task_for(name)
    drawn = traces_of(make_curve(METHODS[name], task), task, instants=50)
    assert np.isfinite(drawn.alpha_body).all()


def test_a_family_that_joins_methods_joins_the_gallery(tmp_path, monkeypatch):
    class Newcomer(METHODS["squad"]):
        name = "newcomer"
        summary = "not there before"

    monkeypatch.setattr(gallery, "METHODS", {"newcomer": Newcomer})
    monkeypatch.setattr(gallery, "compare", lambda task: compare(task, families=gallery.METHODS))
    paths = list(gallery.draw_gallery(tmp_path / "new" / "folder"))
    assert [path.name for path in paths] == ["newcomer.svg", "all.svg"]
    assert "newcomer: not there before" in paths[0].read_text(encoding="utf-8")
    assert "family-newcomer" in ids(paths[1].read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", FIGURES)
def test_figures_of_the_papers_have_something_to_show(name):
    axes = new_figure(6.0, 6.0).subplots()
    FIGURES[name].draw(axes)
    assert axes.has_data()


def test_a_figure_is_written_with_its_title(tmp_path):
    draw_figure(tmp_path / "kks-4.svg", "kks-4")
    text = (tmp_path / "kks-4.svg").read_text(encoding="utf-8")
    assert "Cubic B-spline basis functions" in text
    assert {f"basis-{k}" for k in range(4)} <= ids(text)


def test_basis_functions_sum_to_one_and_cumulative_ones_rise():
    times = np.linspace(0.0, 7.0, 200)
    cumulative = basis.cumulative_functions(np.arange(-3.0, 11.0), 4, times)
    assert cumulative[0] == pytest.approx(1.0)
    assert (np.diff(cumulative, axis=1) > -1e-12).all()
    ordinary = cumulative - np.vstack([cumulative[1:], np.zeros((1, 200))])
    assert ordinary.sum(axis=0) == pytest.approx(1.0)
    assert ordinary.min() > -1e-12


def test_one_axis_of_the_ideal_function_ends_where_it_begins():
    keys = scenes.samples_of_ideal()
    tips = rotate(keys[[0, -1]], np.array([1.0, 0.0, 0.0]))
    assert tips[0] == pytest.approx(tips[1], abs=1e-12)
    assert angle(keys[0], keys[-1]) > 1.0


def test_uniform_knots_loop_between_close_samples_and_chord_knots_do_not():
    keys = scenes.samples_of_ideal()
    direct = angle(keys[4], keys[5])
    travelled = {}
    for times in ("uniform", "chord"):
        curve = METHODS["nielson_heiland"](keys=keys, times=times)
        start, end = curve.knots[[4, 5]]
        q = curve.evaluate(np.linspace(start, end, 400))[0]
        travelled[times] = angle(q[1:], q[:-1]).sum()
    assert travelled["uniform"] > 2.0 * direct
    assert travelled["chord"] < 1.2 * direct


def test_a_sweep_joins_every_two_sections():
    axes = new_figure(3.0, 3.0).subplots()
    section = scenes.cross_section()
    q = np.tile([1.0, 0.0, 0.0, 0.0], (5, 1))
    along = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    draw_sweep(axes, section, SweptPoses(along, q), Viewpoint())
    (painted,) = (part for part in axes.collections if part.get_gid() == "faces")
    assert len(painted.get_paths()) == 4 * len(section)


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OrientdError, match="cannot make the folder"):
        next(gallery.draw_gallery(tmp_path / "file"))


def test_a_picture_of_a_method_is_of_a_known_format(tmp_path):
    with pytest.raises(OrientdError, match=r"must end in \.png, \.svg, \.pdf, got 'x.bmp'"):
        gallery.draw_family(tmp_path / "x.bmp", "min_acceleration")


def test_the_page_of_the_papers_shows_every_figure(tmp_path):
    ((name, text),) = page.pages(tmp_path)
    shown = re.findall(r"\]\((.*)\)", text)
    assert len(shown) == len(FIGURES)
    assert all((tmp_path / name).parent.joinpath(one).stat().st_size > 5_000 for one in shown)
