"""Jets against derivatives taken by mpmath at 50 digits, on both sides of every seam."""

import mpmath
import numpy as np
import pytest

from orientd.curves.construct import jets
from orientd.rotation import conjugate, log_half, multiply

mpmath.mp.dps = 50


def mp_multiply(p, q):
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return [
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    ]


def mp_exp(v):
    n = mpmath.sqrt(sum(x * x for x in v))
    sinc = mpmath.sin(n) / n if n else mpmath.mpf(1)
    return [mpmath.cos(n), *(sinc * x for x in v)]


def mp_log(q):
    n = mpmath.sqrt(sum(x * x for x in q[1:]))
    factor = mpmath.atan2(n, q[0]) / n if n else 1 / q[0]
    return [factor * x for x in q[1:]]


def mp_slerp(p, q, u):
    step = mp_log(mp_multiply([p[0], -p[1], -p[2], -p[3]], q))
    return mp_multiply(p, mp_exp([u * x for x in step]))


def polynomial(coefficients, t):
    return [sum(c * t**k for k, c in enumerate(row)) for row in coefficients]


def jet_of(function, t):
    components = range(len(function(mpmath.mpf(t))))
    orders = [
        [float(mpmath.diff(lambda s, i=i: function(s)[i], t, order)) for i in components]
        for order in range(3)
    ]
    return [np.array([row]) for row in orders]


def as_jet(function, t):
    return jets.Jet(*jet_of(function, t))


def assert_jets_agree(jet, function, t, tolerance):
    for ours, exact in zip((jet.value, jet.first, jet.second), jet_of(function, t), strict=True):
        scale = max(1.0, float(np.max(np.abs(exact))))
        np.testing.assert_allclose(ours, exact, rtol=0.0, atol=tolerance * scale)


V = [["0.3", "-0.7", "0.2", "0.5"], ["-0.4", "0.9", "-0.6", "0.1"], ["0.5", "0.2", "0.8", "-0.3"]]


def vector(scale, offset=0):
    return lambda t: [
        x * mpmath.mpf(scale) + mpmath.mpf(offset) * (k + 1)
        for k, x in enumerate(polynomial([[mpmath.mpf(c) for c in row] for row in V], t))
    ]


# Lengths on both sides of the seam of the entire functions (z = 1/2), and at and near zero.
@pytest.mark.parametrize("scale", ["0", "1e-12", "1e-6", "1e-3", "0.5", "0.87", "0.88", "2", "9"])
def test_exponential_has_exact_derivatives_at_every_length(scale):
    t = 0.4
    function = vector(scale)
    assert_jets_agree(
        jets.exponential(as_jet(function, t)), lambda s: mp_exp(function(s)), t, 3e-15
    )


# Angles on both sides of the seam of the logarithm (cos = 7/8) and nearly antipodal.
@pytest.mark.parametrize(
    ("angle", "tolerance"),
    [("1e-12", 2e-15), ("1e-5", 2e-15), ("0.3", 1e-14), ("0.5053", 2e-14), ("0.5054", 2e-14),
     ("1.5", 2e-14), ("2.9", 1e-12), ("3.1", 1e-10)],
)  # fmt: skip
def test_logarithm_has_exact_derivatives_at_every_angle(angle, tolerance):
    t = 0.4
    size = mpmath.sqrt(sum(x * x for x in vector("1")(mpmath.mpf(t))))
    function = vector(mpmath.mpf(angle) / size)
    jet = as_jet(lambda s: mp_exp(function(s)), t)
    assert_jets_agree(jets.logarithm(jet), function, t, tolerance)


def test_logarithm_is_exact_where_the_points_coincide():
    rate, change = np.array([[0.3, -1.2, 0.7]]), np.array([[2.0, 0.5, -0.1]])
    through_zero = jets.exponential(jets.Jet(np.zeros((1, 3)), rate, change))
    back = jets.logarithm(through_zero)
    np.testing.assert_array_equal(back.value, np.zeros((1, 3)))
    np.testing.assert_allclose(back.first, rate, rtol=1e-15)
    np.testing.assert_allclose(back.second, change, rtol=1e-15)


@pytest.mark.parametrize("gap", ["0", "1e-9", "1e-4", "0.4", "1.5"])
@pytest.mark.parametrize("u", [-0.7, 0.0, 0.3, 1.0, 1.8])
def test_slerp_between_moving_points_has_exact_derivatives(gap, u):
    t = 0.4
    first, second = vector("0.7"), vector("0.7", gap)

    def p(s):
        return mp_exp(first(s))

    def q(s):
        return mp_exp(second(s))

    def along(s):
        return [mpmath.mpf(u) + (s - mpmath.mpf(t)) * mpmath.mpf("1.5")]

    u_jet = jets.linear(np.array([u]), 1.5)
    assert_jets_agree(
        jets.slerp(as_jet(p, t), as_jet(q, t), u_jet),
        lambda s: mp_slerp(p(s), q(s), along(s)[0]),
        t,
        1e-13,
    )


def test_geodesic_equals_slerp_of_constants():
    rng = np.random.default_rng(4)
    p, q = rng.normal(size=(2, 50, 4))
    p /= np.linalg.norm(p, axis=1)[:, None]
    q /= np.linalg.norm(q, axis=1)[:, None]
    u = jets.Jet(*rng.normal(size=(3, 50)))
    step = log_half(multiply(conjugate(p), q))
    ours = jets.geodesic(p, step, u)
    other = jets.slerp(jets.constant(p), jets.constant(q), u)
    np.testing.assert_allclose(ours.value, other.value, atol=1e-14)
    np.testing.assert_allclose(ours.first, other.first, atol=1e-13)
    np.testing.assert_allclose(ours.second, other.second, atol=1e-12)


def test_unit_has_exact_derivatives():
    t = 0.4
    function = vector("1.3")

    def normalized(s):
        c = function(s)
        n = mpmath.sqrt(sum(x * x for x in c))
        return [x / n for x in c]

    assert_jets_agree(jets.unit(as_jet(function, t)), normalized, t, 1e-14)


def test_rates_of_a_fixed_axis_are_physical():
    axis = np.array([[0.0, 0.0, 1.0]])
    angle = jets.Jet(np.array([0.7]), np.array([2.0]), np.array([-3.0]))
    half_vector = angle.times(0.5).widened() * jets.constant(axis)
    _, omega_body, alpha_body = jets.rates(jets.exponential(half_vector))
    np.testing.assert_allclose(omega_body, [[0.0, 0.0, 2.0]], atol=1e-15)
    np.testing.assert_allclose(alpha_body, [[0.0, 0.0, -3.0]], atol=1e-15)
