"""The families that are weights of one slerp triangle: Bezier, B-spline, Catmull-Rom."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import conjugate, exp_half, log_half, multiply

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


def about_one_axis(half_angles):
    return exp_half(np.asarray(half_angles)[:, None] * AXIS)


def half_angles_along(curve, times):
    """The half angles about the axis, and the scalar velocity and acceleration."""
    q, omega, alpha = curve.evaluate(times)
    unwrapped = np.unwrap(2.0 * np.arctan2(q[:, 1:] @ AXIS, q[:, 0])) / 2.0
    return unwrapped, 0.5 * omega @ AXIS, 0.5 * alpha @ AXIS


def jumps(curve):
    knots = curve.knots[1:-1]
    left, right = curve.evaluate(np.nextafter(knots, -np.inf)), curve.evaluate(knots)
    return [np.abs(a - b).max() for a, b in zip(left[1:], right[1:], strict=True)]


@pytest.mark.parametrize("order", [2, 3, 4, 5, 6])
def test_schlag_bspline_about_one_axis_is_the_scalar_bspline(order):
    rng = np.random.default_rng(order)
    angles = np.cumsum(rng.uniform(-0.6, 0.7, 9))
    knots = np.sort(rng.uniform(0.0, 5.0, 9 + order))
    curve = METHODS["schlag_bspline"](control=about_one_axis(angles), order=order, knots=knots)
    scalar = BSpline(knots, angles, order - 1)
    times = np.linspace(*curve.domain, 57)[1:-1]
    value, first, second = half_angles_along(curve, times)
    assert np.abs(value - scalar(times) - np.round((value - scalar(times))[0])).max() < 1e-12
    assert np.abs(first - scalar(times, 1)).max() < 1e-10
    assert np.abs(second - scalar(times, 2)).max() < 1e-8


def test_schlag_bspline_with_repeated_knots_is_less_smooth(random_keys):
    keys = random_keys(8)
    knots = [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 4.0]
    curve = METHODS["schlag_bspline"](control=keys, knots=knots)
    assert curve.continuity == 0
    assert jumps(curve)[0] > 1e-3


def test_a_third_makes_shoemakes_speed_that_of_the_neighbours(random_keys):
    keys = random_keys(5, 0.02)
    across = 2.0 * log_half(multiply(conjugate(keys[:-2]), keys[2:])) / 2.0
    third = METHODS["shoemake_bezier"](keys=keys, times="uniform").evaluate([1.0, 2.0, 3.0])[1]
    whole = METHODS["shoemake_bezier"](keys=keys, times="uniform", s=1.0).evaluate([1.0, 2.0, 3.0])[
        1
    ]
    assert np.abs(third - across).max() < 1e-2 * np.abs(across).max()
    assert np.abs(whole - 3.0 * third).max() < 1e-12


@pytest.mark.parametrize("name", ["shoemake_bezier", "bezier_catmull_rom"])
def test_bezier_splines_are_smooth_for_equal_intervals_only(random_keys, name):
    keys = random_keys(5)
    equal = METHODS[name](keys=keys, times=[0.0, 0.7, 1.4, 2.1, 2.8])
    other = METHODS[name](keys=keys, times=[0.0, 1.0, 1.4, 2.1, 2.8])
    assert (equal.continuity, other.continuity) == (1, 0)
    right = other.evaluate(other.knots[1:-1])[1]
    left = other.evaluate(np.nextafter(other.knots[1:-1], -np.inf))[1]
    cosine = np.sum(left * right, axis=1) / np.prod(
        [np.linalg.norm(side, axis=1) for side in (left, right)], axis=0
    )
    assert np.abs(cosine - 1.0).max() < 1e-12


def test_squad_says_when_its_inner_points_wrap_around(random_keys):
    keys = random_keys(5, np.radians(80.0))
    curve = METHODS["squad"](keys=keys, times=[0.0, 1.0, 41.0, 42.0, 43.0])
    assert curve.continuity == 0
    assert jumps(curve)[0] > 0.1


def test_antipodal_control_quaternions_are_said_to_have_no_arc():
    points = [[1, 0, 0, 0], [-1, 0, 0, 0], [1, 0, 0, 0]]
    curve = METHODS["de_casteljau"](control=points)
    with pytest.raises(PlanError, match="antipodal"):
        curve.evaluate(np.linspace(0.0, 1.0, 21))


@pytest.mark.parametrize("order", ["hamilton", "reversed"])
def test_keyframes_half_a_turn_apart_are_passed_without_a_step_of_the_velocity(order):
    # The neighbours of the one in the middle are a whole turn apart: either way round is as short.
    keys = [[1, 0, 0, 0], [0, 0, 0, 1], [-1, 0, 0, 0]]
    curve = METHODS["bezier_catmull_rom"](keys=keys, times=[0.0, 1.0, 2.0], order=order)
    assert curve.continuity == 1
    before, after = curve.evaluate(np.array([1.0 - 1e-9, 1.0 + 1e-9]))[1]
    assert np.abs(after - before).max() < 1e-6
