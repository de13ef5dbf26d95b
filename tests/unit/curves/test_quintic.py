"""Quintics meet their ends, and a step is smooth."""

import numpy as np
import pytest

from orientd.curves.quintic import (
    UNIT_ACCELERATION,
    UNIT_JERK,
    UNIT_VELOCITY,
    quintics,
    smooth_step,
)


def derivatives(coefficients, time):
    """Return value and first two derivatives at a time since the beginning."""
    return [
        np.array([np.polyval(np.polyder(one[::-1], order), time) for one in coefficients.T])
        for order in range(3)
    ]


def test_quintics_meet_values_and_derivatives_at_both_ends():
    rng = np.random.default_rng(3)
    intervals = 10.0 ** rng.uniform(-2, 1, 40)
    ends = rng.normal(size=(3, 41, 4))
    pieces = quintics(intervals, *ends)
    assert pieces.shape == (40, 6, 4)
    for k, (piece, span) in enumerate(zip(pieces, intervals, strict=True)):
        for side, time in ((k, 0.0), (k + 1, span)):
            for found, wanted, order in zip(
                derivatives(piece, time), ends[:, side], range(3), strict=True
            ):
                assert found * span**order == pytest.approx(wanted * span**order, abs=1e-12)


def test_a_smooth_step_rises_from_rest_to_rest_with_the_peaks_that_are_named():
    u = np.linspace(0.0, 1.0, 10_001)
    step = smooth_step(u)
    assert (step[0], step[-1], step[5000]) == (0.0, pytest.approx(1.0, abs=1e-15), 0.5)
    assert smooth_step(np.array([-1.0, 2.0])) == pytest.approx([0.0, 1.0], abs=1e-15)
    for order, peak in enumerate((UNIT_VELOCITY, UNIT_ACCELERATION, UNIT_JERK), 1):
        assert np.max(np.abs(np.diff(step, order))) * 1e4**order == pytest.approx(peak, rel=1e-3)
