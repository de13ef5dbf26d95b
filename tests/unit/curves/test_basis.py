"""Cumulative B-spline bases: SciPy's B-splines as the outside reference, and their laws."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from orientd.curves.basis import bernstein, cumulative_basis
from orientd.curves.keyframes import inner_multiplicity, resolve_knots

VECTORS = {
    "uniform": np.arange(16.0),
    "random": np.cumsum(np.random.default_rng(0).uniform(0.1, 1.0, 16)),
    "double": np.array([0, 1, 2, 3, 4, 5, 6, 6, 7, 8, 9, 10, 11, 12, 13, 14.0]),
    "wide ratios": np.cumsum(10.0 ** np.tile([0.0, -4.0, 0.0, -2.0], 4)),
}


def samples(basis):
    shares = np.array([0.0, 0.3, 0.99])
    times = (basis.breaks[:-1, None] + shares * np.diff(basis.breaks)[:, None]).ravel()
    return np.repeat(np.arange(len(basis.first)), 3), times


@pytest.mark.parametrize("knots", VECTORS)
@pytest.mark.parametrize("order", [2, 3, 4, 5, 7])
def test_values_and_derivatives_are_sums_of_scipys(knots, order):
    vector = VECTORS[knots]
    basis = cumulative_basis(vector, order)
    span, times = samples(basis)
    found = basis.at(span, times)
    count = len(vector) - order
    for place in range(order - 1):
        for k, (s, t) in enumerate(zip(span, times, strict=True)):
            coefficients = np.zeros(count)
            coefficients[basis.first[s] + place :] = 1.0
            spline = BSpline(vector, coefficients, order - 1)
            shortest = np.diff(basis.breaks)[s]
            assert found[0, place, k] == pytest.approx(spline(t), abs=1e-13)
            for derivative in (1, 2):
                if derivative < order:
                    exact = spline(t, derivative)
                    scale = max(abs(exact), 1e-3 / shortest**derivative)
                    assert abs(found[derivative, place, k] - exact) < 1e-11 * scale


def test_derivatives_on_a_very_short_span_do_not_cancel():
    """Between knots 1e-9 apart the derivative of a wide function is almost constant."""
    vector = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 4.0 + 1e-9, 5.0, 6.0, 7.0, 8.0])
    basis = cumulative_basis(vector, 4)
    place = int(np.argmin(np.diff(basis.breaks)))
    start, end = basis.at(np.array([place, place]), basis.breaks[[place, place + 1]])[1].T
    before = basis.at(np.array([place - 1]), basis.breaks[[place]])[1, :, 0]
    assert np.all(np.array([start, end]) >= 0.0)
    # A function has moved on by as many places as spans have passed.
    passed = basis.first[place] - basis.first[place - 1]
    assert start[: 3 - passed] == pytest.approx(before[passed:], rel=1e-15, abs=1e-15)
    assert end == pytest.approx(start, abs=1e-8)


def test_functions_rise_from_zero_to_one():
    basis = cumulative_basis(VECTORS["random"], 4)
    assert np.all((basis.values >= 0.0) & (basis.values <= 1.0 + 1e-15))
    assert np.all(np.diff(basis.values, axis=2) >= -1e-15)
    assert np.all(basis.rates >= 0.0)


def test_bernstein_polynomials_sum_to_one():
    u = np.linspace(0.0, 1.0, 11)
    for degree in (0, 1, 5, 30):
        weights = bernstein(degree, u)
        assert np.all(weights >= 0.0)
        assert weights.sum(axis=0) == pytest.approx(np.ones(11), abs=1e-14)


@pytest.mark.parametrize(
    ("knots", "problem"),
    [
        ([0, 1, 2], "list of 9 non-decreasing numbers"),
        ([0, 1, 2, 3, 4, 3.5, 6, 7, 8], r"must not decrease, got knots\[5\] = 3.5"),
        ([0, 1, 2, 3, np.inf, 5, 6, 7, 8], "must be finite"),
        ([0, 0, 0, 1, 1, 1, 1, 1, 1], "domain"),
        (["a"] * 9, "non-decreasing numbers"),
    ],
)
def test_knots_that_cannot_be_are_refused(knots, problem):
    with pytest.raises(ValueError, match=problem):
        resolve_knots(knots, 5, 4)


def test_a_knot_repeated_too_often_is_refused():
    with pytest.raises(ValueError, match="repeated at most 1 times for order 2"):
        resolve_knots([0, 0, 1, 1, 2, 2], 4, 2)
    assert inner_multiplicity(resolve_knots([0, 0, 0, 1, 1, 2, 2, 2], 5, 3), 3) == 2
