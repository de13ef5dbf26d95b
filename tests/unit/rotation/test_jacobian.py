"""Jacobians of the exponential map: against mpmath on both sides of the seam, and their laws."""

import mpmath
import numpy as np
import pytest

from orientd import rotation

mpmath.mp.dps = 50
AXIS = np.array([2.0, -3.0, 6.0]) / 7.0
ANGLES = [0.0, 1e-300, 1e-9, 1e-4, 0.1, 0.2499999, 0.25, 0.2500001, 1.0, 3.0, np.pi, 5.0]


def mp_left_jacobian(r):
    r = [mpmath.mpf(float(x)) for x in r]
    theta = mpmath.sqrt(sum(x * x for x in r))
    x, y, z = r
    cross = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    if not theta:
        return mpmath.eye(3)
    with mpmath.workdps(1200):
        first = (1 - mpmath.cos(theta)) / theta**2
        second = (theta - mpmath.sin(theta)) / theta**3
    return mpmath.eye(3) + first * cross + second * cross * cross


def error(actual, exact):
    return max(
        abs(mpmath.mpf(float(actual[i, j])) - exact[i, j]) for i in range(3) for j in range(3)
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_the_jacobian_is_exact_to_rounding(angle):
    r = angle * AXIS
    assert error(rotation.right_jacobian(-r), mp_left_jacobian(r)) < 1e-15


@pytest.mark.parametrize("angle", ANGLES)
def test_the_inverse_jacobian_is_exact_to_rounding(angle):
    r = angle * AXIS
    exact = mp_left_jacobian(r) ** -1
    assert error(rotation.right_jacobian_inverse(-r), exact) < 2e-15 * (1.0 + angle)


@pytest.mark.parametrize("of", [rotation.right_jacobian, rotation.right_jacobian_inverse])
def test_jacobians_of_opposite_vectors_are_transposes(of):
    r = np.random.default_rng(0).normal(size=(20, 3))
    assert of(-r) == pytest.approx(np.swapaxes(of(r), -1, -2), abs=1e-15)


def test_jacobians_times_their_inverses_are_the_identity():
    r = 1.5 * np.random.default_rng(1).normal(size=(50, 3))
    product = rotation.right_jacobian(r) @ rotation.right_jacobian_inverse(r)
    assert product == pytest.approx(np.broadcast_to(np.eye(3), (50, 3, 3)), abs=1e-12)


def test_jacobians_take_the_rate_of_the_vector_to_angular_velocity():
    rng = np.random.default_rng(2)
    r, rate, h = rng.normal(size=(30, 3)), rng.normal(size=(30, 3)), 1e-5
    before, after = rotation.exp(r - h * rate), rotation.exp(r + h * rate)
    body = rotation.log(rotation.multiply(rotation.conjugate(before), after)) / (2 * h)
    world = rotation.log(rotation.multiply(after, rotation.conjugate(before))) / (2 * h)
    right = (rotation.right_jacobian(r) @ rate[..., None])[..., 0]
    left = (rotation.right_jacobian(-r) @ rate[..., None])[..., 0]
    assert right == pytest.approx(body, abs=1e-9)
    assert left == pytest.approx(world, abs=1e-9)


def test_a_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="rotation_vector"):
        rotation.right_jacobian(np.ones(4))
