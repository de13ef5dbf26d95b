"""The kernels of interpolation against SciPy and mpmath."""

import mpmath
import numpy as np
import pytest
import scipy.linalg

from orientd import kernels
from orientd.curves.keyframes import increments
from orientd.curves.newton import solve_banded
from orientd.rotation import between


@pytest.mark.parametrize("lower", [0, 1, 4])
@pytest.mark.parametrize("upper", [0, 2, 5])
@pytest.mark.parametrize("size", [1, 3, 50])
def test_banded_systems_are_solved_as_by_lapack(lower, upper, size):
    rng = np.random.default_rng(size)
    lower, upper = min(lower, size - 1), min(upper, size - 1)
    band, right = rng.normal(size=(lower + upper + 1, size)), rng.normal(size=(size, 2))
    band[upper] += 3.0 * (-1.0) ** np.arange(size)
    expected = scipy.linalg.solve_banded((lower, upper), band, right)
    found = solve_banded(lower, upper, band, right)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert np.array_equal(solve_banded(lower, upper, band, right[:, 0]), found[:, 0])


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_singular_banded_system_is_refused(value):
    band = np.ones((3, 6))
    band[1] = 4.0
    band[:, 3] = value
    with pytest.raises(np.linalg.LinAlgError):
        solve_banded(1, 1, band, np.ones(6))


def test_steps_have_all_digits_at_both_sides_of_every_seam():
    mpmath.mp.dps = 40
    angles = [
        base + sign * offset
        for base in (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4, np.pi)
        for offset in (0.0, 1e-300, 1e-160, 1e-17, 1e-16, 1e-9, 1e-3, 0.3)
        for sign in (-1.0, 1.0)
    ]
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    keys = np.array([[np.cos(x), *np.sin(x) * axis] for x in angles if 0.0 <= x <= np.pi])
    for q in keys:
        steps = increments(np.stack([[1.0, 0.0, 0.0, 0.0], q]))
        turn = [mpmath.mpf(float(x)) for x in between([1.0, 0.0, 0.0, 0.0], q)]
        length = mpmath.sqrt(sum(x * x for x in turn[1:]))
        if not length:
            continue
        factor = mpmath.atan2(length, turn[0]) / length
        for found, part in zip(steps[0], turn[1:], strict=True):
            # Squares of what is below 1e-154 vanish, as everywhere.
            if length > 1e-150:
                assert abs(mpmath.mpf(float(found)) - factor * part) <= 9e-16 * abs(factor * part)


def test_shapes_that_do_not_belong_together_are_refused():
    with pytest.raises(ValueError, match="shapes"):
        kernels.solve_banded(np.ones((3, 4)), 1, 1, np.ones((3, 1)))


def test_equations_of_effort_take_no_increments_that_are_not_there():
    with pytest.raises(ValueError, match="shapes"):
        kernels.linearise_effort(
            np.zeros((3, 3)), np.array([0, 1, 3]), np.zeros((3, 3, 2)), np.ones(2),
            np.empty((0, 3)), np.array([0, 1]), np.ones((1, 2)), np.ones((1, 4)),
            np.empty((1, 9)), np.empty((1, 9, 9)), np.empty((1, 3, 6)), np.empty((1, 3)),
        )  # fmt: skip
