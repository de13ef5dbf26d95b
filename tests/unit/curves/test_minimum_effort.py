"""The spline of least effort: distance from the optimum, derivatives, ends, limits."""

import json
from pathlib import Path

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.curves.keyframes import resolve_times
from orientd.errors import PlanError
from orientd.rotation import align, angle, exp, multiply, normalize

DATA = Path(__file__).parents[2] / "data"
FOUND = json.loads((DATA / "effort" / "optima.json").read_text(encoding="utf-8"))
OPTIMA, INERTIA = FOUND["optima"], np.array(FOUND["inertia"])
LEAST, C2 = METHODS["minimum_effort"], METHODS["c2_cumulative"]
TIMES = np.array([0.0, 1.0, 1.7, 3.0, 3.6, 5.0])
ENDS = {
    "start": "clamped",
    "end": "clamped",
    "omega_start": [1.0, -2.0, 0.5],
    "omega_end": [0.0, 1.5, 2.0],
}


def effort(curve, inertia=None):
    """The integral of squared torque, or acceleration, by Gauss's rule between the knots."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    h = np.diff(curve.knots)[:, None]
    _, omega, torque = curve.evaluate(curve.knots[:-1, None] + 0.5 * h * (1.0 + nodes))
    if inertia is not None:
        torque = torque @ inertia + np.cross(omega, omega @ inertia)
    return float(np.sum(0.5 * h * weights * np.sum(torque * torque, axis=-1)))


def problem(name):
    """Keyframes, times and ends of a golden case."""
    params = json.loads((DATA / "golden" / f"{name}.json").read_text(encoding="utf-8"))["params"]
    keys = align(normalize(params["keys"]))
    asked = {"keys": keys, "times": resolve_times(params.get("times", "uniform"), keys)}
    for side in ("start", "end"):
        if params.get(f"omega_{side}") is not None:
            asked |= {side: "clamped", f"omega_{side}": params[f"omega_{side}"]}
    return asked


@pytest.mark.parametrize("kind", ["acceleration", "torque"])
@pytest.mark.parametrize(("spans", "excess"), [(2, 0.01), (3, 0.005)])
@pytest.mark.parametrize("name", OPTIMA)
def test_the_effort_is_near_the_optimum_on_a_fine_grid(name, spans, excess, kind):
    asked, inertia = problem(name), None if kind == "acceleration" else INERTIA
    curve = LEAST(**asked, spans=spans, inertia=inertia)
    ratio = effort(curve, inertia) / OPTIMA[name][kind]["limit"]
    assert 1.0 - 1e-5 < ratio < 1.0 + excess


@pytest.mark.parametrize("name", OPTIMA)
def test_keyframes_and_end_velocities_are_exact(name):
    asked = problem(name)
    for options in ({}, {"spans": 3, "inertia": INERTIA}, {"order": 6, "smoothness": 2}):
        curve = LEAST(**asked, **options)
        assert angle(curve.evaluate(asked["times"])[0], asked["keys"]).max() < 1e-9
        ends = curve.evaluate(np.array(curve.domain))[1]
        for side, found in zip(("start", "end"), ends, strict=True):
            if f"omega_{side}" in asked:
                wanted = np.array(asked[f"omega_{side}"])
                assert np.linalg.norm(found - wanted) <= 1e-12 * np.linalg.norm(wanted)


@pytest.mark.parametrize("name", OPTIMA)
def test_a_quintic_is_all_but_the_optimum(name):
    for kind, inertia, excess in (("acceleration", None, 2e-4), ("torque", INERTIA, 2e-3)):
        curve = LEAST(**problem(name), order=6, inertia=inertia)
        assert effort(curve, inertia) / OPTIMA[name][kind]["limit"] < 1.0 + excess


@pytest.mark.parametrize("step_deg", [20.0, 100.0, 178.0])
@pytest.mark.parametrize("ends", [{}, ENDS], ids=["natural", "clamped"])
def test_more_spans_take_less_effort_and_two_less_than_none(random_keys, step_deg, ends):
    keys = random_keys(6, np.radians(step_deg))
    efforts = [effort(C2(keys=keys, times=TIMES, **ends))]
    efforts += [effort(LEAST(keys=keys, times=TIMES, spans=n, **ends)) for n in (2, 4, 8)]
    assert np.all(np.diff(efforts) < 0.0)


def test_ten_keyframes_of_170_degrees_take_less_than_a_hundredth_more_than_the_optimum(random_keys):
    keys = random_keys(10, np.radians(170.0), seed=3)
    least = effort(METHODS["min_acceleration"](keys=keys, times="uniform"))
    assert effort(LEAST(keys=keys, times="uniform")) < 1.01 * least
    assert effort(LEAST(keys=keys, times="uniform", spans=3)) < 1.005 * least


def test_no_small_change_of_a_curve_between_its_keyframes_lowers_the_effort(random_keys):
    keys = random_keys(5, 1.5)
    curve = LEAST(keys=keys, times=TIMES[:5], **ENDS, inertia=INERTIA)
    least = effort(curve, INERTIA)
    middles = 0.5 * (TIMES[:4] + TIMES[1:5])
    times = np.sort(np.concatenate([TIMES[:5], middles]))
    points = curve.evaluate(times)[0]
    for seed in range(4):
        for size in (1e-2, -1e-2):
            bent = points.copy()
            turn = size * np.random.default_rng(seed).normal(size=(4, 3))
            bent[1::2] = multiply(points[1::2], exp(turn))
            other = C2(keys=bent, times=times, align=False, **ENDS)
            assert effort(other, INERTIA) > least


def test_the_same_moment_about_every_axis_is_like_none(random_keys):
    keys, times = random_keys(6), np.linspace(0.0, 5.0, 50)
    plain = LEAST(keys=keys, times=TIMES, **ENDS).evaluate(times)
    for inertia in (7.0 * np.eye(3), [0.01, 0.01, 0.01]):
        same = LEAST(keys=keys, times=TIMES, **ENDS, order=4, inertia=inertia).evaluate(times)
        for a, b in zip(plain, same, strict=True):
            assert np.abs(a - b).max() < 1e-9


def test_principal_moments_are_a_diagonal_matrix(random_keys):
    keys = random_keys(5)
    pair = [
        LEAST(keys=keys, times="uniform", inertia=given)
        for given in ([1, 2, 3], np.diag([1.0, 2.0, 3.0]))
    ]
    assert np.array_equal(pair[0].increments, pair[1].increments)


def test_less_torque_is_not_less_acceleration(random_keys):
    keys, inertia = random_keys(6, 2.0), np.diag([1.0, 4.0, 4.5])
    even, heavy = (LEAST(keys=keys, times=TIMES, inertia=given) for given in (None, inertia))
    assert effort(heavy, inertia) < 0.97 * effort(even, inertia)
    assert effort(even) < 0.97 * effort(heavy)


@pytest.mark.parametrize("order", [4, 5, 6])
def test_natural_ends_have_no_acceleration(random_keys, order):
    for keys in (random_keys(6), random_keys(2)):
        curve = LEAST(keys=keys, times=TIMES[: len(keys)], order=order)
        assert np.abs(curve.evaluate(np.array(curve.domain))[2]).max() < 1e-9


def test_free_ends_of_a_body_have_little_torque(random_keys):
    curve = LEAST(keys=random_keys(6, 1.5), times=TIMES, inertia=INERTIA, spans=6)
    _, omega, alpha = curve.evaluate(np.linspace(0.0, 5.0, 200))
    torque = np.linalg.norm(alpha @ INERTIA + np.cross(omega, omega @ INERTIA), axis=1)
    assert max(torque[0], torque[-1]) < 0.01 * torque.max()


def test_velocity_and_acceleration_at_both_ends_of_one_interval(random_keys):
    given = {"alpha_start": [3.0, 0.0, -1.0], "alpha_end": [0.0, 2.0, 0.0]}
    ends = {**ENDS, **given, "start": "state", "end": "state"}
    keys = random_keys(2)
    _, omega, alpha = LEAST(keys=keys, times="uniform", **ends, spans=3).evaluate([0.0, 1.0])
    assert np.abs(omega - [ENDS["omega_start"], ENDS["omega_end"]]).max() < 1e-12
    assert np.abs(alpha - list(given.values())).max() < 1e-11


@pytest.mark.parametrize(("order", "smoothness"), [(4, 2), (5, 2), (5, 3), (6, 2), (6, 3), (6, 4)])
def test_it_is_as_smooth_at_the_keyframes_as_asked(random_keys, order, smoothness):
    curve = LEAST(keys=random_keys(6, 1.2), times=TIMES, order=order, smoothness=smoothness)
    h = 1e-2
    places = (np.arange(9) + 0.5) / 9.0
    for knot in TIMES[1:-1]:
        sides = [
            np.polynomial.polynomial.polyfit(
                side * places, curve.evaluate(knot + side * h * places)[2], 8
            )
            for side in (-1, 1)
        ]
        # Coefficient n is that of derivative n + 2 of the orientation, times h^n / n!.
        jump = np.abs(sides[1] - sides[0]).max(axis=1) / np.abs(sides).max()
        assert np.all(jump[: smoothness - 1] < 3e-8)
        assert jump[smoothness - 1] > 1e-7


@pytest.mark.parametrize("seed", range(3))
def test_a_fast_end_coasts_instead_of_winding_back(random_keys, seed):
    keys = random_keys(5, seed=seed)
    ends = {**ENDS, "omega_start": [0.0, 0.0, 20.0], "omega_end": [-16.0, 12.0, 0.0]}
    curve = LEAST(keys=keys, times="uniform", **ends)
    assert angle(curve.evaluate(np.arange(5.0))[0], keys).max() < 1e-9
    assert effort(curve) < 0.7 * effort(C2(keys=keys, times="uniform", **ends))


@pytest.mark.parametrize("speed", [8.0, 16.0])
def test_intervals_that_turn_by_radians_are_divided_until_less_effort_is_taken(speed):
    keys, spin = np.array([exp([0.0, 0.0, 0.0]), exp([1.5, 0.5, 0.0])]), [0.0, 0.0, speed]
    ends = {"start": "clamped", "end": "clamped", "omega_start": spin, "omega_end": spin}
    curve = LEAST(keys=keys, times=[0.0, 2.6], **ends)
    assert effort(curve) < effort(C2(keys=keys, times=[0.0, 2.6], **ends))
    assert angle(curve.evaluate([0.0, 2.6])[0], keys).max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("step_deg", [10.0, 178.0])
def test_intervals_in_a_ratio_of_10000_are_met_or_refused(random_keys, step_deg):
    keys = random_keys(5, np.radians(step_deg))
    times = np.cumsum([0.0, 1.0, 1e-4, 1.0, 1e-4])
    try:
        curve = LEAST(keys=keys, times=times)
    except PlanError as error:
        assert "neighbouring intervals more alike" in str(error)  # noqa: PT017 - or a right curve
        return
    assert angle(curve.evaluate(times)[0], keys).max() < 1e-9


@pytest.mark.slow
def test_one_short_interval_among_long_ones_is_met(random_keys):
    keys, times = random_keys(4, 0.1), np.cumsum([0.0, 1.0, 1e-4, 1.0])
    curve = LEAST(keys=keys, times=times)
    assert angle(curve.evaluate(times)[0], keys).max() < 1e-9
    assert effort(curve) <= effort(C2(keys=keys, times=times)) * (1.0 + 1e-9)
