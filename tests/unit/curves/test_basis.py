"""Knots of B-splines: very short spans, and vectors that are none."""

import numpy as np
import pytest

from orientd.curves.basis import cumulative_basis
from orientd.curves.keyframes import inner_multiplicity, resolve_knots


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
