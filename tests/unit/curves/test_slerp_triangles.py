"""The families that are weights of one slerp triangle: Bezier, B-spline, Catmull-Rom."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import angle, conjugate, exp, exp_half, log_half, multiply, slerp

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


@pytest.mark.parametrize(("step_deg", "most"), [(10.0, 1e-3), (90.0, 3e-2), (170.0, 8e-2)])
def test_schlag_bspline_is_nearly_but_not_twice_differentiable(random_keys, step_deg, most):
    curve = METHODS["schlag_bspline"](control=random_keys(12, np.radians(step_deg)))
    velocity, acceleration = jumps(curve)
    largest = np.abs(curve.evaluate(np.linspace(*curve.domain, 500))[2]).max()
    assert velocity < 1e-12 * (1.0 + largest)
    assert 1e-6 * largest < acceleration < most * largest


def test_catmull_rom_about_one_axis_is_barry_and_goldmans():
    angles, times = [0.0, 0.4, 1.1, 0.9, 1.3], [0.0, 1.0, 1.5, 3.0, 3.2]
    curve = METHODS["schlag_catmull_rom"](keys=about_one_axis(angles), times=times)
    t, a, b = times, angles, np.array([1.9, 2.4, 2.9])
    linear = [
        (t[j + 1] - b) / (t[j + 1] - t[j]) * a[j] + (b - t[j]) / (t[j + 1] - t[j]) * a[j + 1]
        for j in (1, 2, 3)
    ]
    quadratic = [
        (t[j + 2] - b) / (t[j + 2] - t[j]) * linear[j - 1]
        + (b - t[j]) / (t[j + 2] - t[j]) * linear[j]
        for j in (1, 2)
    ]
    cubic = (t[3] - b) / (t[3] - t[2]) * quadratic[0] + (b - t[2]) / (t[3] - t[2]) * quadratic[1]
    assert np.abs(half_angles_along(curve, b)[0] - cubic).max() < 1e-14


def test_catmull_rom_is_schlags_printed_program(random_keys):
    keys = random_keys(4)
    curve = METHODS["schlag_catmull_rom"](keys=keys, times="uniform")
    q = curve.evaluate([1.3])[0][0]
    t = 0.3
    q10 = slerp(keys[0], keys[1], t + 1.0)
    q11 = slerp(keys[1], keys[2], t)
    q12 = slerp(keys[2], keys[3], t - 1.0)
    q20, q21 = slerp(q10, q11, (t + 1.0) / 2.0), slerp(q11, q12, t / 2.0)
    assert angle(q, slerp(q20, q21, t)) < 2e-14


def test_de_casteljau_leaves_and_arrives_along_its_polygon(random_keys):
    points = random_keys(5)
    curve = METHODS["de_casteljau"](control=points, t0=1.0, t1=3.0)
    q, omega, _ = curve.evaluate([1.0, 3.0])
    first = log_half(multiply(conjugate(points[0]), points[1]))
    last = log_half(multiply(conjugate(points[-2]), points[-1]))
    assert angle(q, points[[0, -1]]).max() < 1e-14
    assert np.abs(omega[0] - 4.0 * 2.0 * first / 2.0).max() < 5e-12
    assert np.abs(omega[1] - 4.0 * 2.0 * last / 2.0).max() < 5e-12


@pytest.mark.parametrize(("degree", "largest"), [(2, 0.0076), (3, 0.018)])
def test_de_casteljau_is_not_the_cumulative_bezier_curve(degree, largest):
    rng = np.random.default_rng(7)
    most = 0.0
    for _ in range(100):
        turns = rng.normal(size=(degree, 3))
        turns *= np.radians(60.0) / np.linalg.norm(turns, axis=1)[:, None]
        points = [np.array([1.0, 0.0, 0.0, 0.0])]
        for turn in exp(turns):
            points.append(multiply(points[-1], turn))
        times = np.linspace(0.0, 1.0, 41)
        one, other = (
            METHODS[name](control=points).evaluate(times)[0]
            for name in ("de_casteljau", "kks_bezier")
        )
        most = max(most, np.abs(one - other).max())
    assert 0.5 * largest < most < 3.0 * largest


def test_a_third_makes_shoemakes_speed_that_of_the_neighbours(random_keys):
    keys = random_keys(5, 0.02)
    across = 2.0 * log_half(multiply(conjugate(keys[:-2]), keys[2:])) / 2.0
    third = METHODS["shoemake_bezier"](keys=keys, times="uniform").evaluate([1.0, 2.0, 3.0])[1]
    whole = METHODS["shoemake_bezier"](keys=keys, times="uniform", s=1.0).evaluate([1.0, 2.0, 3.0])[
        1
    ]
    assert np.abs(third - across).max() < 1e-2 * np.abs(across).max()
    assert np.abs(whole - 3.0 * third).max() < 1e-12


@pytest.mark.parametrize("s", [0.0, -0.1, 1.5, "1/0", "third", np.nan])
def test_a_shortening_that_is_none_is_refused_by_name(random_keys, s):
    with pytest.raises(ValueError, match=r"^s must be"):
        METHODS["shoemake_bezier"](keys=random_keys(3), times="uniform", s=s)


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


def test_the_two_catmull_rom_curves_are_one_about_one_axis_only(random_keys):
    times = np.linspace(0.0, 4.0, 81)

    def largest(keys):
        pair = [
            METHODS[name](keys=keys, times="uniform")
            for name in ("bezier_catmull_rom", "schlag_catmull_rom")
        ]
        return angle(*(curve.evaluate(times)[0] for curve in pair)).max()

    assert largest(about_one_axis([0.0, 0.3, 0.8, 0.2, 0.5])) < 1e-14
    assert largest(random_keys(5, np.radians(90.0))) > np.radians(1.0)


def test_squad_has_the_usual_inner_points_for_equal_intervals(random_keys):
    keys = random_keys(4)
    inverse = conjugate(keys[1:-1])
    ahead, behind = (log_half(multiply(inverse, side)) for side in (keys[2:], keys[:-2]))
    inner = multiply(keys[1:-1], exp_half(-0.25 * (ahead + behind)))
    q = METHODS["squad"](keys=keys, times="uniform").evaluate([1.5])[0][0]
    expected = slerp(slerp(keys[1], keys[2], 0.5), slerp(inner[0], inner[1], 0.5), 0.5)
    assert angle(q, expected) < 1e-14


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
