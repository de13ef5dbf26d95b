"""The number of revolutions of least effort for fast ends."""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.curves.comparison import measure
from orientd.curves.roles import CurveTask
from orientd.rotation import angle, exp, normalize

NAMES = ("kks_hermite", "kks_quintic_hermite")
RANGE = range(-14, 15)


def ends(rate, seed):
    rng = np.random.default_rng(seed)
    omega = rng.normal(size=(2, 3))
    omega *= rate / np.linalg.norm(omega, axis=1)[:, None]
    q = normalize(rng.normal(size=(2, 4)))
    return {"q0": q[0], "q1": q[1], "omega0": omega[0], "omega1": omega[1]}


def effort(name, params, revolutions):
    curve = METHODS[name](**params, revolutions=revolutions)
    task = CurveTask(np.array([params["q0"], params["q1"]]), np.array(curve.domain))
    return measure(curve, task).effort


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("rate", "seed"), [(2.0, 0), (5.0, 1), (20.0, 2), (50.0, 3)])
def test_the_scan_finds_the_least_effort(name, rate, seed):
    params = ends(rate, seed)
    efforts = [effort(name, params, revolutions) for revolutions in RANGE]
    assert effort(name, params, "least") == pytest.approx(min(efforts), rel=1e-6)


def test_no_revolutions_can_cost_many_times_the_least():
    ratios = [
        effort("kks_hermite", params, 0) / effort("kks_hermite", params, "least")
        for params in (ends(5.0, seed) for seed in range(40))
    ]
    assert min(ratios) > 1.0 - 1e-9
    assert max(ratios) > 3.0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("frame", ["body", "world"])
def test_the_ends_are_met_whatever_the_number_is(name, frame):
    params = ends(50.0, 5)
    curve = METHODS[name](**params, frame=frame, revolutions="least")
    plain = METHODS[name](**params, frame=frame)
    for ours, theirs in zip(curve.evaluate([0.0, 1.0]), plain.evaluate([0.0, 1.0]), strict=True):
        if ours.shape[1] == 4:
            assert angle(ours, theirs).max() < 1e-9
    assert np.abs(curve.evaluate([0.0, 1.0])[1] - plain.evaluate([0.0, 1.0])[1]).max() < 1e-9


def test_a_turn_without_a_middle_needs_no_revolutions():
    # The ends bring the whole turn, and nothing is left for the middle.
    q1 = exp(np.array([0.0, 0.0, 2.0]))
    omega = [0.0, 0.0, 3.0]
    params = {"q0": [1.0, 0.0, 0.0, 0.0], "q1": q1, "omega0": omega, "omega1": omega}
    assert effort("kks_hermite", params, "least") == effort("kks_hermite", params, 0)


def test_a_middle_too_small_to_have_an_axis_is_left_as_it_is():
    still = [1.0, 0.0, 0.0, 0.0]
    ends = {"omega0": [0.0, 0.0, 1e-170], "omega1": [0.0, 0.0, 0.0]}
    curve = METHODS["kks_hermite"](q0=still, q1=still, **ends, revolutions="least")
    assert np.abs(curve.evaluate([0.5])[0] - still).max() < 1e-160


def test_another_word_is_refused():
    with pytest.raises(ValueError, match="revolutions must be a whole number or 'least', got 'x'"):
        METHODS["kks_hermite"](**ends(1.0, 0), revolutions="x")
