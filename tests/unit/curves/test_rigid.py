"""Rigid motion: position curves of the same kinds beside the orientations, and what they sweep."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline

from orientd.curves import METHODS
from orientd.plots.papers.position_spline import (
    blended_positions,
    hermite_positions,
    interpolated_positions,
)
from orientd.plots.papers.rigid import (
    RigidMotion,
    blended_motion,
    hermite_motion,
    interpolated_motion,
)
from orientd.rotation import angle, rotate

RNG = np.random.default_rng(11)
POINTS = np.cumsum(RNG.normal(size=(7, 3)), axis=0)
TIMES = np.array([0.0, 1.0, 1.7, 3.0, 3.6, 5.0, 5.5])
OUTLINE = np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [-0.1, 0.0, 0.05]])


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_blended_positions_are_the_bspline_of_the_points(order):
    knots = np.sort(RNG.uniform(0.0, 4.0, 7 + order))
    curve, peer = blended_positions(POINTS, order, knots), BSpline(knots, POINTS, order - 1)
    times = np.linspace(*curve.domain, 41)[1:-1]
    for derivative, ours in enumerate(curve.evaluate(times)):
        assert np.abs(ours - peer(times, derivative)).max() < 1e-9 * 100.0**derivative


@pytest.mark.parametrize(("order", "conditions"), [(4, ["2"]), (6, ["2", "3"])])
def test_interpolated_positions_are_the_natural_spline(order, conditions):
    curve = interpolated_positions(POINTS, TIMES, order)
    edges = [(int(c), np.zeros(3)) for c in conditions]
    peer = make_interp_spline(TIMES, POINTS, k=order - 1, bc_type=(edges, edges))
    times = np.linspace(0.0, 5.5, 60)
    for derivative, ours in enumerate(curve.evaluate(times)):
        assert np.abs(ours - peer(times, derivative)).max() < 1e-8


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_interpolated_positions_meet_points_and_end_velocities(order):
    start, end = [[1.0, 2.0, 3.0]], [[0.0, -1.0, 0.5]]
    curve = interpolated_positions(POINTS, TIMES, order, start, end)
    position, velocity, _ = curve.evaluate(TIMES)
    assert np.abs(position - POINTS).max() < 1e-12
    assert np.abs(velocity[[0, -1]] - [start[0], end[0]]).max() < 1e-11


def test_hermite_positions_meet_both_ends():
    curve = hermite_positions([0, 0, 0], [1, 2, 3], [4, 0, 0], [0, 0, -5], 1.0, 3.0)
    position, velocity, _ = curve.evaluate([1.0, 3.0])
    assert np.abs(position - [[0, 0, 0], [1, 2, 3]]).max() < 1e-14
    assert np.abs(velocity - [[4, 0, 0], [0, 0, -5]]).max() < 1e-13


def motions(random_keys):
    keys = random_keys(7)
    ends = {"omega0": [0.0, 0.0, 9.0], "omega1": [1.0, 0.0, 7.0], "revolutions": 2}
    travel = {"p0": POINTS[0], "p1": POINTS[1], "v0": [1.0, 0.0, 2.0], "v1": [0.0, 1.0, 0.0]}
    return [
        hermite_motion(q0=keys[0], q1=keys[1], t1=2.0, **ends, **travel),
        blended_motion(control=keys, positions=POINTS),
        interpolated_motion(keys=keys, positions=POINTS, times=TIMES),
        interpolated_motion(keys=keys, positions=POINTS, times=TIMES, order=5),
        interpolated_motion(
            keys=keys, positions=POINTS, times="chord", order=6, omega_start=[1, 2, 3]
        ),
    ]


def test_velocities_are_the_derivatives_of_the_poses(random_keys):
    for motion in motions(random_keys):
        times = np.linspace(*motion.domain, 23)[1:-1] + 0.001
        h = 1e-5
        ahead, behind = motion.evaluate(times + h), motion.evaluate(times - h)
        here = motion.evaluate(times)
        measured = (ahead.position - behind.position) / (2 * h)
        assert np.abs(measured - here.velocity).max() < 1e-7 * (1 + np.abs(here.velocity).max())
        placed = (ahead.placed(OUTLINE) - behind.placed(OUTLINE)) / (2 * h)
        moving = here.point_velocities(OUTLINE)
        assert np.abs(placed - moving).max() < 1e-6 * (1 + np.abs(moving).max())


def test_interpolated_motion_meets_every_pose(random_keys):
    keys = random_keys(7)
    poses = interpolated_motion(keys=keys, positions=POINTS, times=TIMES).evaluate(TIMES)
    assert angle(poses.q, keys).max() < 1e-12
    assert np.abs(poses.position - POINTS).max() < 1e-12


def test_an_outline_is_placed_at_each_instant(random_keys):
    motion = blended_motion(control=random_keys(7), positions=POINTS)
    times = np.linspace(*motion.domain, 40)
    poses = motion.evaluate(times)
    surface = poses.placed(OUTLINE)
    assert surface.shape == (40, 3, 3)
    assert np.abs(surface[7] - poses.position[7] - rotate(poses.q[7], OUTLINE)).max() < 1e-14


def test_curves_over_different_times_are_refused(random_keys):
    orientation = METHODS["squad"](keys=random_keys(4))
    with pytest.raises(ValueError, match="position must have the domain of orientation"):
        RigidMotion(orientation=orientation, position=blended_positions(POINTS))


@pytest.mark.parametrize("points", [[[1.0, 2.0]], "here", [[np.nan, 0, 0]] * 7, POINTS[:2]])
def test_positions_that_are_none_are_refused_by_name(random_keys, points):
    with pytest.raises(ValueError, match=r"^positions must be"):
        blended_motion(control=random_keys(7), positions=points)


def test_as_many_positions_as_orientations_are_needed(random_keys):
    with pytest.raises(ValueError, match="as many as control, 7, got 6"):
        blended_motion(control=random_keys(7), positions=POINTS[:6])
    with pytest.raises(ValueError, match="each of the 6 points"):
        interpolated_motion(keys=random_keys(7), positions=POINTS[:6])
