"""The plain-float quaternions against the array functions, which are checked against mpmath."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orientd import floats, rotation

component = st.floats(-4.0, 4.0)
vector = st.tuples(component, component, component)


@given(vector, vector)
def test_product_difference_and_log_agree_with_the_arrays(a, b):
    p, q = floats.exp(a), floats.exp(b)
    np.testing.assert_allclose(p, rotation.exp(np.array(a)), atol=1e-15)
    product = floats.multiply(p, q)
    np.testing.assert_allclose(product, rotation.multiply(np.array(p), np.array(q)), atol=1e-15)
    found = np.array(floats.difference(p, q))
    wanted = rotation.log(rotation.multiply(rotation.conjugate(np.array(p)), np.array(q)))
    if abs(np.linalg.norm(wanted) - np.pi) > 1e-6:
        np.testing.assert_allclose(found, wanted, atol=1e-14)


@given(vector, vector)
def test_rotate_back_is_the_inverse_rotation(a, v):
    q = floats.exp(a)
    wanted = rotation.rotate(rotation.conjugate(np.array(q)), np.array(v))
    np.testing.assert_allclose(floats.rotate_back(q, v), wanted, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-160, 1e-149, 1e-20, 1e-8, 1e-3])
def test_tiny_rotations_keep_their_relative_precision(size):
    r = (0.6 * size, 0.0, -0.8 * size)
    assert floats.log(floats.exp(r)) == pytest.approx(r, rel=1e-15, abs=1e-320)
