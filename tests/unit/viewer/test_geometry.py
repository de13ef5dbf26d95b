"""Lines and meshes of the scene."""

from types import SimpleNamespace

import numpy as np
import pytest

from orientd import planner, rotation
from orientd.daemon.planners import reporting
from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State
from orientd.viewer import geometry

TURNS = [[0.0, 0.0, 0.0], [0.5, -0.3, 0.4], [0.2, 0.6, 1.1], [-0.5, 0.4, 1.7]]


@pytest.fixture(scope="module")
def motion():
    keys = rotation.exp(TURNS)
    request = MotionRequest(keyframes=[Keyframe(q=tuple(q)) for q in keys.tolist()], approach=True)
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    return planner.plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)


def test_tips_are_the_columns_of_the_matrices():
    q = rotation.exp(TURNS)
    matrices = rotation.to_matrix(q)
    for axis in range(3):
        assert geometry.tips(q)[axis] == pytest.approx(matrices[:, :, axis])


@pytest.mark.parametrize("rate_hz", [100.0, 17.0])
def test_keyframes_are_where_they_were_asked_for(motion, rate_hz):
    samples = reporting.samples_of(motion, rate_hz)
    found = geometry.keyframe_orientations(reporting.plan_of(motion), samples)
    errors = rotation.angle(found, rotation.exp(TURNS))
    # Between samples the angular velocity is taken as constant.
    assert errors.max() < DEFAULT_LIMITS.acceleration / 8.0 / rate_hz**2


def test_signs_of_the_samples_do_not_matter(motion):
    samples, plan = reporting.samples_of(motion, 100.0), reporting.plan_of(motion)
    signs = np.where(np.arange(len(samples.times)) % 2, 1.0, -1.0)[:, None]
    flipped = SimpleNamespace(times=samples.times, q=samples.q * signs)
    errors = rotation.angle(
        geometry.keyframe_orientations(plan, samples), geometry.keyframe_orientations(plan, flipped)
    )
    assert errors.max() < 1e-7


def test_strokes_are_the_part_of_the_line_that_the_pattern_says():
    around = np.linspace(0.0, 6.0, 6001)
    line = np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=-1)
    strokes = geometry.dashed(line, (0.3, 0.1))
    length = np.linalg.norm(strokes[:, 1] - strokes[:, 0], axis=1).sum()
    assert length == pytest.approx(0.75 * 6.0, rel=1e-3)
    assert len(geometry.dashed(line, ())) == 6000


def volume(vertices, faces):
    """Of a closed surface; positive where its faces look outwards (divergence theorem)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def test_meshes_are_closed_and_look_outwards():
    vertices, faces = geometry.tube(0.1, 0.6, 0.02, sides=200)
    assert volume(vertices, faces) == pytest.approx(np.pi * 0.02**2 * 0.5, rel=1e-3)
    vertices, faces = geometry.arrow(0.3, 0.006)
    assert volume(vertices, faces) > 0.0
    assert vertices[:, 2].max() == 0.3


def test_circles_are_about_their_axis():
    for axis in range(3):
        circle = geometry.circle(axis)
        assert np.linalg.norm(circle, axis=1) == pytest.approx(np.ones(len(circle)))
        assert circle[:, axis] == pytest.approx(np.zeros(len(circle)))
