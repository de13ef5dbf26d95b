"""The largest turns of setpoints in each period, against the plain mathematics."""

import numpy as np
import pytest

from orientd.kernels import turn_sizes
from orientd.rotation import conjugate, exp, log, multiply

PARTS, PERIODS = 8, 60


@pytest.fixture(scope="module")
def q():
    """Return orientations along an uneven way; every third one has the other sign."""
    change = np.random.default_rng(5).normal(size=(PERIODS * PARTS + 1, 3))
    found = exp(1e-4 * np.cumsum(np.cumsum(change, axis=0), axis=0))
    found[::3] *= -1.0
    return found


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("reach", [1, 5, 8])
def test_sizes_are_those_of_differences_of_rotation_vectors(q, order, reach):
    turns = log(multiply(conjugate(q[:-reach]), q[reach:]))
    for _ in range(order - 1):
        turns = turns[reach:] - turns[:-reach]
    norms = np.linalg.norm(turns, axis=1, keepdims=True)
    sizes = np.concatenate([norms, np.abs(turns)], axis=1)
    # A difference counts in the period of its last setpoint.
    lead = np.zeros((order * reach, 4))
    expected = np.concatenate([lead, sizes])[: PERIODS * PARTS].reshape(PERIODS, PARTS, 4).max(1)
    found = np.empty((PERIODS, 4))
    turn_sizes(q, order, reach, PARTS, found)
    assert found == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("change", [{"order": 4}, {"reach": 0}, {"parts": 0}, {"reach": 600}])
def test_sizes_beyond_the_setpoints_are_refused(q, change):
    given = {"order": 1, "reach": 8, "parts": PARTS} | change
    with pytest.raises(ValueError, match="shapes"):
        turn_sizes(q, given["order"], given["reach"], given["parts"], np.empty((PERIODS, 4)))
