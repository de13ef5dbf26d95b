"""Laws that hold for every family in METHODS, whatever it is made of."""

import contextlib
from inspect import signature

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import angle, conjugate, multiply, normalize, rotate

QUATERNIONS = ("keys", "control", "q0", "q1", "M1")
BODY_VECTORS = ("omega_start", "omega_end", "alpha_start", "alpha_end", "axis")
FRAMED_VECTORS = ("omega0", "omega1", "alpha0", "alpha1")
TURN = normalize([0.3, -0.8, 0.1, 0.5])
CLOSE = 1e-9


def inner_times(curve, per_span=7):
    """Instants away from the knots."""
    inside = (np.arange(per_span) + 0.5) / per_span
    return (curve.knots[:-1, None] + inside * np.diff(curve.knots)[:, None]).ravel()


def jumps(curve):
    """The largest jump of orientation, velocity and acceleration at the inner knots."""
    knots = curve.knots[1:-1]
    right = curve.evaluate(knots)
    left = curve.evaluate(np.nextafter(knots, -np.inf))
    return (
        angle(left[0], right[0]).max(),
        np.abs(left[1] - right[1]).max(),
        np.abs(left[2] - right[2]).max(),
    )


def transformed(params, side):
    """The same parameters seen from another world frame (left) or body frame (right)."""
    changed = dict(params)
    frame = params.get("frame", "body")
    for name, value in params.items():
        if name in QUATERNIONS and value is not None:
            changed[name] = multiply(TURN, value) if side == "left" else multiply(value, TURN)
        if name == "inertia" and side == "right":
            moments = np.asarray(value)
            matrix = np.diag(moments) if moments.ndim == 1 else moments
            half = rotate(conjugate(TURN), matrix.T)
            changed[name] = rotate(conjugate(TURN), half.T)
        is_body = name in BODY_VECTORS or (name in FRAMED_VECTORS and frame == "body")
        is_world = name in FRAMED_VECTORS and frame == "world"
        if value is not None and is_body and side == "right":
            changed[name] = rotate(conjugate(TURN), value)
        if value is not None and is_world and side == "left":
            changed[name] = rotate(TURN, value)
    return changed


def assert_same(curve, other, times, tolerance=CLOSE):
    for (q, omega, alpha), (q2, omega2, alpha2) in [(curve.evaluate(times), other.evaluate(times))]:
        assert angle(q, q2).max() < tolerance
        assert np.abs(omega - omega2).max() < tolerance * max(1.0, np.abs(omega).max())
        assert np.abs(alpha - alpha2).max() < 10 * tolerance * max(1.0, np.abs(alpha).max())


def test_keyframes_are_met(example, keyframes_of):
    if not example.family.interpolates:
        pytest.skip("approximates its keyframes")
    keys, times = keyframes_of(example.params())
    assert angle(example.curve().evaluate(times)[0], keys).max() < CLOSE


def test_the_norm_is_one_everywhere(example):
    curve = example.curve(step=2.0)
    q = curve.evaluate(np.linspace(*curve.domain, 500))[0]
    assert np.abs(np.linalg.norm(q, axis=1) - 1.0).max() < 1e-14


def test_the_sign_of_the_quaternion_does_not_jump(example):
    curve = example.curve()
    q = curve.evaluate(np.linspace(*curve.domain, 2000))[0]
    assert np.sum(q[1:] * q[:-1], axis=1).min() > 0.9


def test_velocity_is_the_derivative_of_the_orientation(example):
    curve = example.curve()
    t = inner_times(curve)
    h = 1e-3 * np.diff(curve.knots).min()
    omega = curve.evaluate(t)[1]
    q = [curve.evaluate(t + k * h)[0] for k in range(-3, 4)]
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    rate = sum(w * p for w, p in zip(weights, q, strict=True))
    measured = 2.0 * multiply(conjugate(q[3]), rate)[:, 1:]
    assert np.abs(measured - omega).max() < 1e-9 * (1.0 + np.abs(omega).max())


def test_acceleration_is_the_derivative_of_the_velocity(example):
    curve = example.curve()
    t = inner_times(curve)
    h = 1e-3 * np.diff(curve.knots).min()
    alpha = curve.evaluate(t)[2]
    omega = [curve.evaluate(t + k * h)[1] for k in range(-3, 4)]
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    measured = sum(w * o for w, o in zip(weights, omega, strict=True))
    assert np.abs(measured - alpha).max() < 1e-8 * (1.0 + np.abs(alpha).max())


def test_declared_continuity_holds_at_the_knots(example):
    curve = example.curve()
    assert curve.continuity in (0, 1, 2)
    if len(curve.knots) > 2:
        scale = [
            1.0,
            *(1.0 + np.abs(part).max() for part in curve.evaluate(inner_times(curve))[1:]),
        ]
        for order in range(curve.continuity + 1):
            assert jumps(curve)[order] < 1e-8 * scale[order]


def test_declared_continuity_is_not_understated(example):
    curve = example.curve()
    if len(curve.knots) > 2 and curve.continuity < 2:
        assert jumps(curve)[curve.continuity + 1] > 1e-6


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_change_of_frame_changes_nothing_else(example, side):
    curve = example.curve()
    other = example.family(**transformed(example.params(), side))
    times = np.linspace(*curve.domain, 50)
    q, omega, alpha = curve.evaluate(times)
    q2, omega2, alpha2 = other.evaluate(times)
    if side == "left":
        q = multiply(TURN, q)
    else:
        q = multiply(q, TURN)
        omega, alpha = (rotate(conjugate(TURN), part) for part in (omega, alpha))
    assert angle(q, q2).max() < CLOSE
    assert np.abs(omega - omega2).max() < CLOSE * (1.0 + np.abs(omega).max())
    assert np.abs(alpha - alpha2).max() < 10 * CLOSE * (1.0 + np.abs(alpha).max())


def test_signs_of_the_keyframes_do_not_matter_when_aligned(example):
    params = example.params()
    if "align" in params and not params["align"]:
        pytest.skip("takes quaternions as given")
    signs = np.random.default_rng(1).choice([-1.0, 1.0], size=(100, 1))
    flipped = dict(params)
    for name in QUATERNIONS[:2]:
        if name in params:
            flipped[name] = params[name] * signs[: len(params[name])]
    if "q1" in params:
        flipped["q1"] = -params["q1"]
    curve = example.family(**params)
    assert_same(curve, example.family(**flipped), np.linspace(*curve.domain, 50))


def test_end_velocities_are_met(example):
    if not example.family.meets_end_velocities:
        pytest.skip("takes no end velocities")
    params = example.params()
    curve = example.curve()
    q, omega, alpha = curve.evaluate(np.array(curve.domain))
    if params.get("frame") == "world":
        omega, alpha = rotate(q, omega), rotate(q, alpha)
    for names in (("omega_start", "alpha_start"), ("omega0", "alpha0")):
        for name, measured in zip(names, (omega[0], alpha[0]), strict=True):
            if params.get(name) is not None:
                assert measured == pytest.approx(params[name], abs=CLOSE)
    for names in (("omega_end", "alpha_end"), ("omega1", "alpha1")):
        for name, measured in zip(names, (omega[1], alpha[1]), strict=True):
            if params.get(name) is not None:
                assert measured == pytest.approx(params[name], abs=CLOSE)


def test_a_local_family_changes_only_near_a_moved_keyframe(example):
    if not example.family.local:
        pytest.skip("not local")
    params = example.params(24)
    name = next((name for name in ("keys", "control") if name in params), None)
    if name is None:
        pytest.skip("a single segment")
    moved = dict(params)
    moved[name] = np.array(params[name])
    moved[name][12] = multiply(moved[name][12], normalize([1.0, 0.1, 0.0, 0.2]))
    curve, other = example.family(**params), example.family(**moved)
    knots = curve.knots
    start = knots[max(0, len(knots) // 2 - 6)]
    end = knots[min(len(knots) - 1, len(knots) // 2 + 6)]
    times = np.linspace(*curve.domain, 400)
    far = (times < start) | (times > end)
    assert far.sum() > 100
    assert_same(curve, other, times[far])
    assert angle(curve.evaluate(times)[0], other.evaluate(times)[0]).max() > 1e-3


def test_the_order_of_the_instants_does_not_matter(example):
    curve = example.curve()
    times = np.linspace(*curve.domain, 301)
    order = np.random.default_rng(2).permutation(301)
    shuffled = curve.evaluate(times[order])
    for sorted_part, part in zip(curve.evaluate(times), shuffled, strict=True):
        assert np.abs(sorted_part[order] - part).max() < 1e-12


def test_a_sample_does_not_depend_on_how_many_are_asked_for(example):
    curve = example.curve()
    times = np.linspace(*curve.domain, 9001)
    few = curve.evaluate(times[::3000])
    for many, part in zip(curve.evaluate(times), few, strict=True):
        assert np.abs(many[::3000] - part).max() < 1e-12


def test_results_follow_the_shape_of_the_instants(example):
    curve = example.curve()
    start, end = curve.domain
    for shape in [(), (0,), (2, 3), (1,)]:
        q, omega, alpha = curve.evaluate(np.full(shape, 0.5 * (start + end)))
        assert q.shape == (*shape, 4)
        assert omega.shape == alpha.shape == (*shape, 3)


def test_results_go_into_the_buffer_given(example):
    curve = example.curve()
    times = np.linspace(*curve.domain, 77)
    out = np.full((10, 77), np.nan)
    fresh, filled = curve.evaluate(times), curve.evaluate(times, out=out)
    for new, old in zip(fresh, filled, strict=True):
        assert np.shares_memory(old, out)
        assert np.array_equal(new, old)
    with pytest.raises(ValueError, match="out must be"):
        curve.evaluate(times, out=np.empty((10, 78)))


def test_instants_outside_the_domain_are_refused(example):
    curve = example.curve()
    start, end = curve.domain
    span = end - start
    for t in (start - 1e-9 * span, end + 1e-9 * span, np.nan, np.inf):
        with pytest.raises(ValueError, match="domain"):
            curve.evaluate([0.5 * (start + end), t])


def test_rounding_at_the_ends_of_the_domain_is_forgiven(example):
    curve = example.curve()
    ends = np.array(curve.domain)
    outside = np.array([np.nextafter(ends[0], -np.inf), np.nextafter(ends[1], np.inf)])
    for inner, outer in zip(curve.evaluate(ends), curve.evaluate(outside), strict=True):
        assert np.array_equal(inner, outer)


def test_an_unknown_parameter_is_named(example):
    with pytest.raises((TypeError, ValueError), match="sprocket"):
        example.family(**example.params(), sprocket=1)


def test_a_quaternion_far_from_unit_norm_is_refused_by_name(example):
    params = example.params()
    for name in QUATERNIONS[:4]:
        if name in params:
            bad = {**params, name: 1.001 * np.asarray(params[name])}
            with pytest.raises(ValueError, match=rf"{name}.*norm 1"):
                example.family(**bad)


def test_parameters_that_are_not_numbers_are_refused_by_name(example):
    for name, value in example.params().items():
        if isinstance(value, np.ndarray):
            for wrong in (np.full_like(value, np.nan), "north", [[1.0], [2.0, 3.0]]):
                with pytest.raises(ValueError, match=name):
                    example.family(**{**example.params(), name: wrong})


def test_nonsense_in_a_parameter_is_refused_as_a_mistake(example):
    for name in signature(example.family).parameters:
        for wrong in ("x", [], {}, object(), float("nan"), [[1.0], [2.0, 3.0]], 10**400):
            # Some of it may be taken: an empty list of turns, say.
            with contextlib.suppress(ValueError, PlanError):
                example.family(**{**example.params(), name: wrong})


def test_times_must_increase(example):
    params = example.params()
    if "times" in params:
        with pytest.raises(ValueError, match="times must increase strictly"):
            example.family(**{**params, "times": np.zeros(len(params["keys"]))})


def test_parameters_are_left_as_they_were(example):
    params = example.params()
    before = {name: np.copy(value) for name, value in params.items()}
    curve = example.family(**params)
    curve.evaluate(np.linspace(*curve.domain, 20))
    for name, value in params.items():
        if isinstance(value, np.ndarray):
            assert np.array_equal(value, before[name])


def test_every_family_says_what_it_is():
    for name, family in METHODS.items():
        assert family.name == name
        assert family.summary
        assert family.source
        assert (family.__doc__ or "").strip()
