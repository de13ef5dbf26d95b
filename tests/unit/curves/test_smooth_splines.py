"""The global C2 families and beyond: rotation-vector spline, least acceleration, higher orders."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

from orientd.curves import METHODS
from orientd.curves.keyframes import increments
from orientd.errors import PlanError
from orientd.rotation import angle, exp, multiply

VECTOR, LEAST = METHODS["rotation_vector_spline"], METHODS["min_acceleration"]
HIGHER, C2 = METHODS["kks_interpolating"], METHODS["c2_cumulative"]
TIMES = np.array([0.0, 1.0, 1.7, 3.0, 3.6, 5.0])
ENDS = {
    "start": "clamped",
    "end": "clamped",
    "omega_start": [1.0, -2.0, 0.5],
    "omega_end": [0.0, 1.5, 2.0],
}


def effort(curve, places=24):
    """The integral of squared angular acceleration, by Gauss's rule between the knots."""
    nodes, weights = np.polynomial.legendre.leggauss(places)
    h = np.diff(curve.knots)[:, None]
    alpha = curve.evaluate(curve.knots[:-1, None] + 0.5 * h * (1.0 + nodes))[2]
    return float(np.sum(0.5 * h * weights * np.sum(alpha * alpha, axis=-1)))


def derivative(curve, times, h=1e-3):
    """The derivative of the angular acceleration, by differences of eighth order."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    return sum(w * curve.evaluate(times + k * h)[2] for k, w in enumerate(weights, -4)) / h


# SciPy stops after ten iterations, which leaves it behind for larger steps.
@pytest.mark.parametrize(("step_deg", "tolerance"), [(10.0, 1e-11), (60.0, 1e-9), (90.0, 1e-8)])
def test_with_mean_end_rates_it_is_scipys_rotation_spline(random_keys, step_deg, tolerance):
    keys = random_keys(6, np.radians(step_deg))
    mean = 2.0 * increments(keys) / np.diff(TIMES)[:, None]
    given = {"start": "clamped", "end": "clamped", "omega_start": mean[0], "omega_end": mean[-1]}
    curve = VECTOR(keys=keys, times=TIMES, **given)
    peer = RotationSpline(TIMES, Rotation.from_quat(keys[:, [1, 2, 3, 0]]))
    times = np.linspace(0.0, 5.0, 300)
    q, omega, alpha = curve.evaluate(times)
    assert angle(q, peer(times).as_quat()[:, [3, 0, 1, 2]]).max() < tolerance
    assert np.abs(omega - peer(times, 1)).max() < tolerance * np.abs(omega).max()
    assert np.abs(alpha - peer(times, 2)).max() < 10 * tolerance * np.abs(alpha).max()


@pytest.mark.parametrize("family", [VECTOR, LEAST, HIGHER], ids=lambda family: family.name)
def test_natural_ends_have_no_acceleration(random_keys, family):
    alpha = family(keys=random_keys(6), times=TIMES).evaluate([0.0, 5.0])[2]
    assert np.abs(alpha).max() < 1e-9


@pytest.mark.parametrize("step_deg", [20.0, 100.0, 175.0])
@pytest.mark.parametrize("ends", [{}, ENDS], ids=["natural", "clamped"])
def test_no_other_family_takes_less_acceleration(random_keys, step_deg, ends):
    keys = random_keys(6, np.radians(step_deg))
    least = effort(LEAST(keys=keys, times=TIMES, **ends))
    for family in (VECTOR, C2):
        assert least < effort(family(keys=keys, times=TIMES, **ends))


def test_the_second_derivative_of_the_velocity_stands_still_in_the_world(random_keys):
    curve = LEAST(keys=random_keys(6), times=TIMES, **ENDS)
    for i in range(5):
        times = np.linspace(TIMES[i], TIMES[i + 1], 12)[2:-2]
        jerk, omega = derivative(curve, times), curve.evaluate(times)[1]
        change = (derivative(curve, times + 1e-3) - derivative(curve, times - 1e-3)) / 2e-3
        assert np.abs(change - np.cross(jerk, omega)).max() < 1e-4 * (1.0 + np.abs(jerk).max())


@pytest.mark.parametrize("seed", range(3))
def test_a_fast_end_coasts_instead_of_winding_back(random_keys, seed):
    keys = random_keys(5, seed=seed)
    ends = {**ENDS, "omega_start": [0.0, 0.0, 20.0], "omega_end": [-16.0, 12.0, 0.0]}
    curve = LEAST(keys=keys, times="uniform", **ends)
    assert angle(curve.evaluate(np.arange(5.0))[0], keys).max() < 1e-10
    assert effort(curve) < 0.7 * effort(C2(keys=keys, times="uniform", **ends))


def test_orders_above_four_have_two_conditions_at_each_end(random_keys):
    keys = random_keys(5)
    given = {**ENDS, "alpha_start": [3.0, 0.0, -1.0]}
    for order in (5, 6):
        _, omega, alpha = HIGHER(keys=keys, times="uniform", order=order, **given).evaluate(
            [0.0, 4.0]
        )
        assert np.abs(omega - [ENDS["omega_start"], ENDS["omega_end"]]).max() < 1e-12
        assert np.abs(alpha - [[3.0, 0.0, -1.0], [0.0, 0.0, 0.0]]).max() < 1e-11


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_an_order_is_continuous_in_two_derivatives_less(random_keys, order):
    curve = HIGHER(keys=random_keys(6, 1.2), times=TIMES, order=order)
    h = 1e-2
    places = (np.arange(9) + 0.5) / 9.0
    for knot in curve.knots[1:-1]:
        sides = [
            np.polynomial.polynomial.polyfit(
                side * h * places / h, curve.evaluate(knot + side * h * places)[2], 8
            )
            for side in (-1, 1)
        ]
        # Coefficient n is that of derivative n + 2 of the orientation, times h^n / n!.
        size = np.abs(sides).max()
        jump = np.abs(sides[1] - sides[0]).max(axis=1) / size
        assert np.all(jump[: order - 3] < 1e-8)
        assert jump[order - 3] > 1e-7


@pytest.mark.parametrize("order", [3, 5, 6])
@pytest.mark.parametrize("step_deg", [120.0, 170.0])
def test_every_order_reaches_large_steps(random_keys, order, step_deg):
    keys = random_keys(10, np.radians(step_deg), seed=3)
    curve = HIGHER(keys=keys, times="uniform", order=order)
    assert angle(curve.evaluate(np.arange(10.0))[0], keys).max() < 1e-12


def test_fast_ends_of_a_high_order_gather_no_turns_that_lead_nowhere():
    keys = np.array([exp([0.0, 0.0, 0.0]), exp([1.5, 0.5, 0.4])])
    spin = {"start": "clamped", "end": "clamped"}
    spin |= {"omega_start": [0.0, 0.0, 16.0], "omega_end": [0.0, 0.0, 16.0]}
    for whole in np.linspace(0.0, 2.0 * np.pi, 9):
        both = np.array([keys[0], multiply(keys[1], exp([0.0, 0.0, whole]))])
        curve = HIGHER(keys=both, times=[0.0, 2.6], **spin)
        assert effort(curve) < 4000.0
        _, omega, _ = curve.evaluate([0.0, 2.6])
        assert np.abs(omega - [0.0, 0.0, 16.0]).max() < 1e-9
        assert angle(curve.evaluate([0.0, 2.6])[0], both).max() < 1e-9


def test_a_search_that_does_not_end_says_so(random_keys):
    keys, times = random_keys(6, 0.7), np.cumsum([0.0, 1e-3, 1.0, 100.0, 1.0, 1e-3])
    with pytest.raises(PlanError, match="does not converge"):
        LEAST(keys=keys, times=times)


@pytest.mark.parametrize("order", [3, 4, 5, 6])
def test_an_interpolating_spline_tells_the_instants_of_its_keyframes(random_keys, order):
    curve = HIGHER(keys=random_keys(6), times=TIMES, order=order)
    assert np.array_equal(curve.key_times, TIMES)
