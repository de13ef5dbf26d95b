"""Splines fitted to measured orientations, held against the turning that was measured."""

import math

import numpy as np
import pytest
from hand_held import DROPOUT, recorded, truth

from orientd import rotation
from orientd.curves.fitting import fit_orientations
from orientd.errors import PlanError

DEGREE = math.radians(1.0)


def away(fit, count=5000):
    """Return instants all over the fit's domain, and how far it is from the truth there."""
    t = np.linspace(*fit.curve.domain, count)
    return t, rotation.angle(fit.curve.evaluate(t)[0], truth(t))


@pytest.mark.parametrize("seed", range(6))
def test_a_hand_held_recording_is_met_within_the_bound_with_few_knots(seed):
    t, q = recorded(seed)
    fit = fit_orientations(t, q, tolerance=DEGREE)
    instants, error = away(fit)
    # At the edges of a gap, half a second of it, there are samples on one side only.
    is_known = (instants < DROPOUT[0] - 0.1) | (instants > DROPOUT[1] + 0.1)
    assert float(error[is_known].max()) <= DEGREE
    assert fit.error <= DEGREE
    # Where nothing was recorded for half a second, the curve goes on about as before.
    assert float(error.max()) <= 3.0 * DEGREE
    assert 10 * len(np.unique(fit.knots)) <= len(t)
    assert fit.samples.noise == pytest.approx(0.5 * DEGREE, rel=0.15)


def test_wild_samples_are_left_out_and_others_are_not():
    t, q = recorded(3, wild=0)
    assert fit_orientations(t, q).samples.left_out <= 2
    assert 8 <= fit_orientations(*recorded(3)).samples.left_out <= 10


@pytest.mark.parametrize("place", [0, 1, 2, 3, -4, -3, -2, -1])
def test_a_wild_sample_near_an_end_takes_none_but_the_outermost_with_it(place):
    t, q = recorded(3, seconds=15.0, wild=0)
    q[place] = rotation.multiply(q[place], rotation.exp([0.0, 2.0, 0.5]))
    fit = fit_orientations(t, q)
    assert fit.samples.left_out <= 4
    assert float(away(fit)[1].max()) <= DEGREE


@pytest.mark.parametrize("tolerance_deg", [1.0, 0.1, 0.01])
def test_without_noise_any_bound_is_held(tolerance_deg):
    t = np.arange(0.0, 10.0, 0.01)
    fit = fit_orientations(t, truth(t), tolerance=tolerance_deg * DEGREE)
    _, error = away(fit)
    assert fit.curve.domain == (t[0], t[-1])
    assert float(error.max()) <= tolerance_deg * DEGREE
    assert 10 * len(np.unique(fit.knots)) <= len(t)


def test_fewer_knots_serve_a_wider_bound():
    t = np.arange(0.0, 10.0, 0.01)
    counts = [
        len(np.unique(fit_orientations(t, truth(t), tolerance=bound * DEGREE).knots))
        for bound in (3.0, 0.1, 0.01)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[1] < counts[2]


def test_signs_of_samples_do_not_matter():
    t, q = recorded(0, seconds=10.0)
    flipped = q * np.random.default_rng(9).choice([-1.0, 1.0], size=len(q))[:, None]
    one, other = fit_orientations(t, q), fit_orientations(t, flipped)
    assert np.all(one.knots == other.knots)
    assert float(rotation.angle(one.control, other.control).max()) < 1e-9


def test_order_of_samples_does_not_matter():
    t, q = recorded(0, seconds=10.0)
    mixed = np.random.default_rng(9).permutation(len(t))
    one, other = fit_orientations(t, q), fit_orientations(t[mixed], q[mixed])
    assert np.all(one.knots == other.knots)


def test_another_world_frame_turns_the_fit_along():
    t, q = recorded(0, seconds=10.0)
    g = rotation.exp([0.3, -2.0, 1.1])
    one, other = fit_orientations(t, q), fit_orientations(t, rotation.multiply(g, q))
    np.testing.assert_allclose(other.knots, one.knots)
    moved = rotation.multiply(g, one.control)
    assert float(rotation.angle(moved, other.control).max()) < 1e-4


def test_whole_turns_are_followed():
    t = np.arange(0.0, 20.0, 0.02)
    q = rotation.exp(np.outer(2.0 * t, [0.6, 0.0, 0.8]))
    fit = fit_orientations(t, q, tolerance=0.1 * DEGREE)
    _, omega, _ = fit.curve.evaluate(np.linspace(1.0, 19.0, 500))
    np.testing.assert_allclose(omega @ [0.6, 0.0, 0.8], 2.0, atol=0.05)


def test_missing_samples_and_rough_norms_are_put_up_with():
    t, q = recorded(1, seconds=10.0)
    q = q * np.random.default_rng(2).uniform(0.9, 1.1, size=(len(q), 1))
    q[5:9], t[20] = np.nan, np.nan
    q[30] = 0.0
    fit = fit_orientations(np.append(t, t[40]), np.vstack([q, q[40]]))
    assert fit.samples.left_out >= 7
    assert float(away(fit)[1].max()) <= 1.5 * DEGREE


def test_a_bound_below_the_noise_is_refused_with_one_that_is_not():
    with pytest.raises(PlanError, match=r"noise is 0\.\d+ deg per axis; allow 0?\.?\d"):
        fit_orientations(*recorded(0, seconds=20.0), tolerance=0.05 * DEGREE)


def test_a_jump_is_named_with_its_time_and_not_called_noise():
    t = np.arange(0.0, 4.0, 0.01)
    q = truth(t)
    q[200:] = rotation.multiply(rotation.exp([3.0, 0.0, 0.0]), q[200:])
    place = r"they jump by 1[67]\d deg within 0\.\d+ s at (1\.9|2\.0)\d+ s; cut the recording there"
    with pytest.raises(PlanError, match=place):
        fit_orientations(t, q)


def test_times_of_arrival_are_not_called_noise():
    t = np.arange(0.0, 10.0, 0.02)
    arrivals = t[9::10].repeat(10) + np.tile(2e-4 * np.arange(10), 50)
    with pytest.raises(PlanError, match="the times look like times of arrival, not of measurement"):
        fit_orientations(arrivals, truth(3.0 * t))


def test_more_than_a_tenth_of_outliers_is_refused_with_the_time_of_the_first():
    t = np.arange(0.0, 20.0, 0.02)
    q = truth(t)
    wild = np.arange(100, len(t), 8)
    q[wild] = rotation.multiply(q[wild], rotation.exp([1.0, 0.3, 0.0]))
    with pytest.raises(PlanError, match=r"of 1000 samples are outliers.*the first at 2.000 s"):
        fit_orientations(t, q)


def test_too_few_samples_are_refused():
    with pytest.raises(PlanError, match="at least 8 samples, got 5"):
        fit_orientations(np.arange(5.0), truth(np.arange(5.0)))


def test_a_mistake_of_the_caller_is_named():
    t, q = recorded(0, seconds=3.0)
    with pytest.raises(ValueError, match="tolerance must be positive"):
        fit_orientations(t, q, tolerance=0.0)
    with pytest.raises(ValueError, match=r"shapes \(n,\) and \(n, 4\)"):
        fit_orientations(t, q[:, :3])


def test_standing_still_takes_no_knots():
    t = np.arange(0.0, 5.0, 0.02)
    fit = fit_orientations(t, np.tile(truth(1.0), (len(t), 1)))
    assert len(np.unique(fit.knots)) == 2
    assert float(rotation.angle(fit.control, truth(1.0)).max()) < 1e-9
