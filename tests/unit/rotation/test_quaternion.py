"""The quaternion algebra: laws on random input, values against mpmath with 50 digits."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from orientd import rotation

mpmath.mp.dps = 50
EPS = np.finfo(float).eps

components = st.floats(-1.0, 1.0, allow_subnormal=False)
quaternions = (
    arrays(np.float64, 4, elements=components)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(rotation.normalize)
)
vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0, allow_subnormal=False))
LENGTHS = [0.0, 1e-300, 1e-160, 1e-20, 1e-9, 1e-8, 1e-4, 0.1, 1.0, 3.0]
NEAR_PI = [np.pi - d for d in (1.0, 1e-3, 1e-8, 1e-12, 1e-15)]
AXIS = np.array([2.0, -3.0, 6.0]) / 7.0


def mp_exp_half(v):
    v = [mpmath.mpf(float(x)) for x in v]
    length = mpmath.sqrt(sum(x * x for x in v))
    sinc = mpmath.sin(length) / length if length else mpmath.mpf(1)
    return [mpmath.cos(length), *(sinc * x for x in v)]


def mp_log_half(q):
    w, *v = [mpmath.mpf(float(x)) for x in q]
    length = mpmath.sqrt(sum(x * x for x in v))
    factor = mpmath.atan2(length, w) / length if length else 1 / w
    return [factor * x for x in v]


def error(actual, exact):
    return max(abs(mpmath.mpf(float(a)) - e) for a, e in zip(actual, exact, strict=True))


def mp_norm(v):
    return mpmath.sqrt(sum(x * x for x in v))


@given(quaternions, quaternions, quaternions)
def test_multiplication_is_associative(p, q, r):
    left = rotation.multiply(rotation.multiply(p, q), r)
    assert left == pytest.approx(rotation.multiply(p, rotation.multiply(q, r)), abs=1e-15)


@given(quaternions)
def test_the_conjugate_is_the_inverse(q):
    identity = rotation.multiply(q, rotation.conjugate(q))
    assert identity == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-15)


def test_products_of_the_units_are_hamiltons():
    one, i, j, k = np.eye(4)
    assert np.array_equal(rotation.multiply(i, j), k)
    assert np.array_equal(rotation.multiply(j, k), i)
    assert np.array_equal(rotation.multiply(k, i), j)
    assert np.array_equal(rotation.multiply(j, i), -k)
    assert np.array_equal(rotation.multiply(k, k), -one)


@given(quaternions, quaternions, vectors)
def test_the_product_rotates_by_the_right_factor_first(p, q, v):
    both = rotation.rotate(rotation.multiply(p, q), v)
    assert both == pytest.approx(rotation.rotate(p, rotation.rotate(q, v)), abs=1e-13)


@given(quaternions, vectors)
def test_rotation_is_the_sandwich_product(q, v):
    sandwich = rotation.multiply(
        rotation.multiply(q, np.concatenate([[0.0], v])), rotation.conjugate(q)
    )
    assert rotation.rotate(q, v) == pytest.approx(sandwich[1:], abs=1e-13)


@pytest.mark.parametrize("length", LENGTHS + NEAR_PI + [10.0, 500.0])
def test_half_angle_exponential_is_exact_to_rounding(length):
    v = length * AXIS
    assert error(rotation.exp_half(v), mp_exp_half(v)) < 2 * EPS * max(1.0, length)


@pytest.mark.parametrize("length", LENGTHS[:7])
def test_small_exponentials_keep_their_relative_precision(length):
    v = length * AXIS
    exact = mp_exp_half(v)
    assert error(rotation.exp_half(v)[1:], exact[1:]) <= 2 * EPS * mp_norm(exact[1:])


@pytest.mark.parametrize("length", LENGTHS + NEAR_PI)
def test_half_angle_logarithm_keeps_its_relative_precision(length):
    q = rotation.exp_half(length * AXIS)
    exact = mp_log_half(q)
    assert error(rotation.log_half(q), exact) <= 4 * EPS * mp_norm(exact)


@pytest.mark.parametrize("length", LENGTHS + NEAR_PI)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_logarithm_inverts_the_exponential_up_to_a_half_turn(length, sign):
    r = length * AXIS
    assert rotation.log(sign * rotation.exp(r)) == pytest.approx(r, rel=1e-14, abs=0.0)


def test_logarithm_of_the_identity_is_exactly_zero():
    for w in (1.0, -1.0):
        assert np.array_equal(rotation.log([w, 0.0, 0.0, 0.0]), np.zeros(3))


def test_logarithm_of_a_half_turn_has_the_axis_as_given():
    assert rotation.log([0.0, *AXIS]) == pytest.approx(np.pi * AXIS)
    assert rotation.log([-0.0, *AXIS]) == pytest.approx(np.pi * AXIS)


def test_half_angle_logarithm_of_minus_one_is_a_whole_turn_about_x():
    assert np.array_equal(rotation.log_half([-1.0, 0.0, 0.0, 0.0]), [np.pi, 0.0, 0.0])


def test_what_is_a_unit_quaternion_to_rounding_stays_as_it_is_to_the_last_digit():
    rng = np.random.default_rng(0)
    units = rotation.normalize(rng.normal(size=(1000, 4)))
    assert np.array_equal(rotation.check_unit(units), units)
    mixed = np.array([units[0], 1.0000001 * units[1]])
    assert np.array_equal(rotation.check_unit(mixed)[0], units[0])
    assert np.linalg.norm(rotation.check_unit(mixed)[1]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("size", [1e-150, 1e-157, 1e-165, 1e-300])
def test_the_logarithm_of_nearly_minus_one_is_as_long_as_it_should_be(size):
    q = np.array([-1.0, size, size, size])
    assert np.linalg.norm(rotation.log_half(q)) == pytest.approx(np.pi, rel=1e-15)


@given(quaternions)
def test_logarithms_are_bounded(q):
    assert np.linalg.norm(rotation.log(q)) <= np.pi * (1 + EPS)
    assert np.linalg.norm(rotation.log_half(q)) <= np.pi * (1 + EPS)


@given(quaternions)
def test_exponentials_invert_the_logarithms(q):
    assert rotation.exp_half(rotation.log_half(q)) == pytest.approx(q, abs=4e-15)
    assert rotation.angle(rotation.exp(rotation.log(q)), q) < 4e-15


@given(quaternions, quaternions)
def test_slerp_starts_and_ends_at_its_arguments(p, q):
    assert rotation.slerp(p, q, 0.0) == pytest.approx(p, abs=1e-15)
    assert rotation.slerp(p, q, 1.0) == pytest.approx(q, abs=1e-14)


@given(quaternions, quaternions, st.floats(-1.0, 2.0))
def test_slerp_is_left_and_right_equivariant(p, q, u):
    turn = rotation.normalize([1.0, 2.0, -3.0, 0.5])
    if np.linalg.norm(p + q) < 1e-3:
        return
    there = rotation.slerp(p, q, u)
    left = rotation.slerp(rotation.multiply(turn, p), rotation.multiply(turn, q), u)
    right = rotation.slerp(rotation.multiply(p, turn), rotation.multiply(q, turn), u)
    assert left == pytest.approx(rotation.multiply(turn, there), abs=1e-10)
    assert right == pytest.approx(rotation.multiply(there, turn), abs=1e-10)


@given(quaternions, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_powers_add(q, a, b):
    product = rotation.multiply(rotation.power(q, a), rotation.power(q, b))
    assert rotation.power(q, a + b) == pytest.approx(product, abs=1e-13)


@pytest.mark.parametrize("length", LENGTHS + NEAR_PI)
def test_angle_is_the_length_of_the_rotation_between(length):
    p = rotation.normalize([1.0, -2.0, 0.5, 0.3])
    q = rotation.multiply(p, rotation.exp(length * AXIS))
    assert rotation.angle(p, q) == pytest.approx(length, rel=1e-14, abs=3e-16)
    assert rotation.angle(p, -q) == pytest.approx(length, rel=1e-14, abs=3e-16)


def test_aligned_neighbours_have_no_negative_dot_product():
    qs = rotation.normalize(np.random.default_rng(3).normal(size=(5, 200, 4)))
    aligned = rotation.align(qs)
    assert np.array_equal(aligned[:, 0], qs[:, 0])
    assert np.all(np.sum(aligned[:, 1:] * aligned[:, :-1], axis=-1) >= 0.0)
    assert np.array_equal(np.abs(aligned), np.abs(qs))


def test_alignment_leaves_a_half_turn_as_it_was_given():
    one, i, j, _ = np.eye(4)
    assert np.array_equal(rotation.align([one, -one, i, -j, j]), [one, one, i, -j, -j])


def test_functions_broadcast_over_leading_axes():
    rng = np.random.default_rng(4)
    p = rotation.normalize(rng.normal(size=(3, 1, 4)))
    q = rotation.normalize(rng.normal(size=(5, 4)))
    assert rotation.multiply(p, q).shape == (3, 5, 4)
    assert rotation.slerp(p, q, 0.3).shape == (3, 5, 4)
    assert rotation.angle(p, q).shape == (3, 5)
    assert rotation.rotate(p, np.ones((5, 3))).shape == (3, 5, 3)
    assert rotation.multiply(p, q)[2, 4] == pytest.approx(rotation.multiply(p[2, 0], q[4]))


def test_arguments_are_not_modified():
    q = np.array([[2.0, 0.0, 0.0, 0.0], [-2.0, 0.0, 0.0, 0.0]])
    before = q.copy()
    rotation.normalize(q)
    rotation.align(q)
    rotation.log(q)
    assert np.array_equal(q, before)


def test_normalising_survives_extreme_scales():
    for scale in (1e-300, 1.0, 1e300):
        unit = rotation.normalize(scale * np.array([1.0, 2.0, 2.0, 4.0]))
        assert unit == pytest.approx([0.2, 0.4, 0.4, 0.8])


@pytest.mark.parametrize("wrong", [[0.0] * 4, [np.nan, 0.0, 0.0, 1.0], [np.inf, 0.0, 0.0, 0.0]])
def test_what_cannot_be_normalised_is_refused(wrong):
    with pytest.raises(ValueError, match="finite and not zero"):
        rotation.normalize(wrong)


def test_a_norm_off_by_more_than_the_tolerance_is_refused():
    q = np.array([0.6, 0.0, 0.8, 0.0])
    assert np.linalg.norm(rotation.check_unit(q * (1 + 5e-7))) == pytest.approx(1.0, abs=1e-15)
    with pytest.raises(ValueError, match=r"norm must be 1 within 1e-06, got 1.000002"):
        rotation.check_unit(q * (1 + 2e-6))
    with pytest.raises(ValueError, match="finite"):
        rotation.check_unit([np.nan, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "call",
    [
        lambda: rotation.multiply(np.ones(3), np.ones(4)),
        lambda: rotation.log(1.0),
        lambda: rotation.exp(np.ones(4)),
        lambda: rotation.rotate(np.ones(4), np.ones(4)),
        lambda: rotation.align(np.ones(4)),
    ],
)
def test_wrong_shapes_are_refused(call):
    with pytest.raises(ValueError, match="shape"):
        call()
