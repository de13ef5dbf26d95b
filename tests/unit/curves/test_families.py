"""What single families promise beyond the shared laws: smoothness, tension, refusals."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import exp_half

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
REPEATED_KNOTS = [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 4.0]


def jumps(curve):
    """Return the largest jumps of velocity and acceleration at the inner knots."""
    knots = curve.knots[1:-1]
    left, right = curve.evaluate(np.nextafter(knots, -np.inf)), curve.evaluate(knots)
    return [np.abs(a - b).max() for a, b in zip(left[1:], right[1:], strict=True)]


@pytest.mark.parametrize("order", [2, 3, 4, 5, 6])
def test_schlag_bspline_about_one_axis_is_the_scalar_bspline(order):
    rng = np.random.default_rng(order)
    angles = np.cumsum(rng.uniform(-0.6, 0.7, 9))
    knots = np.sort(rng.uniform(0.0, 5.0, 9 + order))
    control = exp_half(angles[:, None] * AXIS)
    curve = METHODS["schlag_bspline"](control=control, order=order, knots=knots)
    scalar = BSpline(knots, angles, order - 1)
    times = np.linspace(*curve.domain, 57)[1:-1]
    q, omega, alpha = curve.evaluate(times)
    value = np.unwrap(2.0 * np.arctan2(q[:, 1:] @ AXIS, q[:, 0])) / 2.0
    off = value - scalar(times)
    assert np.abs(off - np.round(off[0])).max() < 1e-12
    assert np.abs(0.5 * omega @ AXIS - scalar(times, 1)).max() < 1e-10
    assert np.abs(0.5 * alpha @ AXIS - scalar(times, 2)).max() < 1e-8


@pytest.mark.parametrize(
    ("name", "count", "step", "given", "continuity", "least_jump"),
    [
        ("schlag_bspline", 8, 1.0, {"knots": REPEATED_KNOTS}, 0, 1e-3),
        ("shoemake_bezier", 5, 1.0, {"times": [0.0, 0.7, 1.4, 2.1, 2.8]}, 1, 0.0),
        ("shoemake_bezier", 5, 1.0, {"times": [0.0, 1.0, 1.4, 2.1, 2.8]}, 0, 1e-3),
        ("bezier_catmull_rom", 5, 1.0, {"times": [0.0, 0.7, 1.4, 2.1, 2.8]}, 1, 0.0),
        ("bezier_catmull_rom", 5, 1.0, {"times": [0.0, 1.0, 1.4, 2.1, 2.8]}, 0, 1e-3),
        # Inner points that wrap around
        ("squad", 5, np.radians(80.0), {"times": [0.0, 1.0, 41.0, 42.0, 43.0]}, 0, 0.1),
        ("spherical_quadratic", 3, 2.5, {"times": [0.0, 1.0, 9.0], "M1": 0}, 0, 0.1),
    ],
)
def test_a_curve_says_how_smooth_it_is(
    random_keys, name, count, step, given, continuity, least_jump
):
    keys = random_keys(count, step)
    given = {key: keys[value] if key == "M1" else value for key, value in given.items()}
    kind = "control" if "control" in METHODS[name].takes else "keys"
    curve = METHODS[name](**{kind: keys}, **given)
    assert curve.continuity == continuity
    assert jumps(curve)[0] >= least_jump


@pytest.mark.parametrize("order", ["hamilton", "reversed"])
def test_keyframes_half_a_turn_apart_are_passed_without_a_step_of_the_velocity(order):
    # The neighbours of the one in the middle are a whole turn apart: either way round is as short.
    keys = [[1, 0, 0, 0], [0, 0, 0, 1], [-1, 0, 0, 0]]
    curve = METHODS["bezier_catmull_rom"](keys=keys, times=[0.0, 1.0, 2.0], order=order)
    assert curve.continuity == 1
    before, after = curve.evaluate(np.array([1.0 - 1e-9, 1.0 + 1e-9]))[1]
    assert np.abs(after - before).max() < 1e-6


def test_tension_makes_the_acceleration_jump_by_itself_times_the_velocity(random_keys):
    nu = np.array([3.0, 0.5, 8.0, 0.0, 2.0])
    curve = METHODS["nu_spline"](keys=random_keys(5), times=[0.0, 1.0, 1.7, 3.0, 4.0], nu=nu)
    knots = curve.knots[1:-1]
    _, omega, after = curve.evaluate(knots)
    before = curve.evaluate(np.nextafter(knots, 0.0))[2]
    assert np.abs(after - before - nu[1:-1, None] * omega).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "given", "problem"),
    [
        ("de_casteljau", {"control": [[1, 0, 0, 0], [-1, 0, 0, 0], [1, 0, 0, 0]]}, "antipodal"),
        (
            "normalized_cubic",
            {"keys": [[1, 0, 0, 0], [-1, 0, 0, 0]], "times": "uniform", "align": False},
            r"passes through zero at t = 0\.5 s",
        ),
    ],
)
def test_a_curve_without_a_direction_says_where(name, given, problem):
    with pytest.raises(PlanError, match=problem):
        METHODS[name](**given).evaluate(np.linspace(0.0, 1.0, 21))


@pytest.mark.parametrize(
    ("order", "knots", "problem"),
    [
        (4, [0, 1, 2], "list of 9 non-decreasing numbers"),
        (4, [0, 1, 2, 3, 4, 3.5, 6, 7, 8], r"must not decrease, got knots\[5\] = 3.5"),
        (4, [0, 1, 2, 3, np.inf, 5, 6, 7, 8], "must be finite"),
        (4, [0, 0, 0, 1, 1, 1, 1, 1, 1], "domain"),
        (4, ["a"] * 9, "non-decreasing numbers"),
        (2, [0, 0, 1, 1, 2, 2, 3], "repeated at most 1 times for order 2"),
    ],
)
def test_knots_that_cannot_be_are_refused(random_keys, order, knots, problem):
    with pytest.raises(ValueError, match=problem):
        METHODS["schlag_bspline"](control=random_keys(5), order=order, knots=knots)
