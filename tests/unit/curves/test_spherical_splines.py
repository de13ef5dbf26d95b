"""The global spherical families: quadratic, Nielson and Heiland's, normalised cubics."""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.curves.inner_points import best_first_point, criterion_values
from orientd.curves.sphere import slerp_jacobians
from orientd.errors import PlanError
from orientd.rotation import angle, conjugate, exp_half, log_half, multiply, normalize, slerp

QUADRATIC, HEILAND = METHODS["spherical_quadratic"], METHODS["nielson_heiland"]


@pytest.mark.parametrize("criterion", [20, 21])
def test_no_other_first_inner_point_is_better_than_the_one_found(random_keys, criterion):
    keys, ratios = random_keys(5, seed=2), np.array([0.8, 1.5, 0.9])
    found = best_first_point(keys, ratios, criterion)
    least = criterion_values(found[None], keys, ratios, criterion)[0]
    others = normalize(np.random.default_rng(0).normal(size=(5000, 4)))
    assert criterion_values(others, keys, ratios, criterion).min() > least - 1e-12


@pytest.mark.parametrize("gap", [1e-9, 0.8, 2.9])
@pytest.mark.parametrize("share", [-0.4, 0.0, 0.3, 1.0, 1.7])
def test_the_derivatives_of_a_slerp_are_its_differences(gap, share):
    p = normalize(np.random.default_rng(3).normal(size=(1, 4)))
    q = multiply(p, exp_half(gap * np.array([[0.6, -0.8, 0.0]])))
    u, e = np.array([share]), 1e-5
    for place, matrix in enumerate(slerp_jacobians(p, q, u)):
        for axis in range(3):
            moved = []
            for sign in (1.0, -1.0):
                ends = [p, q]
                ends[place] = multiply(ends[place], exp_half(sign * e * np.eye(3)[axis]))
                moved.append(log_half(multiply(conjugate(slerp(p, q, u)), slerp(*ends, u)))[0])
            assert np.abs((moved[0] - moved[1]) / (2.0 * e) - matrix[0, :, axis]).max() < 1e-8


def test_an_inner_arc_that_wraps_around_is_said_to_break_the_velocity(random_keys):
    curve = QUADRATIC(keys=random_keys(3, 2.5), M1=random_keys(3, 2.5)[0], times=[0.0, 1.0, 9.0])
    assert curve.continuity == 0
    left = curve.evaluate(np.nextafter(curve.knots[1:-1], 0.0))[1]
    assert np.abs(left - curve.evaluate(curve.knots[1:-1])[1]).max() > 0.1


@pytest.mark.parametrize("seed", range(20))
def test_the_spherical_bspline_meets_keyframes_up_to_135_degrees_apart(random_keys, seed):
    keys = random_keys(10, np.radians(135.0), seed)
    curve = HEILAND(keys=keys, times="uniform")
    assert angle(curve.evaluate(curve.knots)[0], keys).max() < 1e-12


@pytest.mark.parametrize("seeds", [(0, 5), pytest.param(range(8), marks=pytest.mark.slow)])
def test_a_spherical_bspline_that_is_not_found_is_said_not_to_be(random_keys, seeds):
    found = 0
    for seed in seeds:
        keys = random_keys(10, np.radians(175.0), seed)
        try:
            curve = HEILAND(keys=keys, times="uniform")
        except PlanError as error:
            assert "misses one" in str(error)  # noqa: PT017 - either outcome is right
        else:
            found += 1
            assert angle(curve.evaluate(curve.knots)[0], keys).max() < 1e-12
    assert 0 < found < len(seeds)


def test_tension_makes_the_acceleration_jump_by_itself_times_the_velocity(random_keys):
    nu = np.array([3.0, 0.5, 8.0, 0.0, 2.0])
    curve = METHODS["nu_spline"](keys=random_keys(5), times=[0.0, 1.0, 1.7, 3.0, 4.0], nu=nu)
    knots = curve.knots[1:-1]
    _, omega, after = curve.evaluate(knots)
    before = curve.evaluate(np.nextafter(knots, 0.0))[2]
    assert np.abs(after - before - nu[1:-1, None] * omega).max() < 1e-9


def test_without_tension_the_nu_spline_is_the_normalised_cubic(random_keys):
    keys, times = random_keys(6), np.linspace(0.0, 5.0, 100)
    one, other = (
        METHODS["nu_spline"](keys=keys, times="uniform"),
        METHODS["normalized_cubic"](keys=keys, times="uniform"),
    )
    assert one.continuity == 2
    for a, b in zip(one.evaluate(times), other.evaluate(times), strict=True):
        assert np.array_equal(a, b)


def test_a_spline_through_zero_is_said_to_have_no_direction():
    keys = [[1, 0, 0, 0], [-1, 0, 0, 0]]
    with pytest.raises(PlanError, match=r"passes through zero at t = 0\.5 s"):
        METHODS["normalized_cubic"](keys=keys, times="uniform", align=False)


def test_a_spline_that_passes_near_zero_turns_quickly_there():
    keys = [[1, 0, 0, 0], [-1, 0, 1e-9, 0]]
    curve = METHODS["normalized_cubic"](keys=keys, times="uniform", align=False)
    assert curve.evaluate([0.5])[1][0, 1] == pytest.approx(8e9, rel=1e-4)
    assert angle(curve.evaluate([0.0, 1.0])[0], normalize(keys)).max() < 1e-12
