"""Properties of the interpolating cumulative spline beyond the shared laws: steps, turns, ends."""

import numpy as np
import pytest

from orientd import rotation
from orientd.curves import METHODS
from orientd.errors import PlanError

C2 = METHODS["c2_cumulative"]


def walk(count, step, seed=0):
    """Keyframes at turns of exactly *step* rad about random axes."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count - 1, 3))
    turns *= step / np.linalg.norm(turns, axis=1)[:, None]
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for turn in rotation.exp(turns):
        keys.append(rotation.normalize(rotation.multiply(keys[-1], turn)))
    return np.array(keys)


def assert_interpolates_smoothly(curve, keys, times):
    q, omega, alpha = curve.evaluate(times)
    assert rotation.angle(q, keys).max() < 1e-11
    _, before, change = curve.evaluate(np.nextafter(times[1:-1], -np.inf))
    # A trajectory is fitted to orientations, at instants that are rounded.
    room = 1e-8 + 1e6 * np.spacing(times[-1])
    assert np.abs(before - omega[1:-1]).max(initial=0.0) < room * np.abs(omega).max()
    assert np.abs(change - alpha[1:-1]).max(initial=0.0) < room * np.abs(alpha).max()


ENDS = {
    "natural": {},
    "clamped": {
        "start": "clamped",
        "end": "clamped",
        "omega_start": [3.0, -2.0, 1.0],
        "omega_end": [0.0, 4.0, 0.0],
    },
    "state": {
        "start": "state",
        "end": "state",
        "omega_start": [3.0, -2.0, 1.0],
        "omega_end": [0.0, 4.0, 0.0],
        "alpha_start": [0.0, 10.0, 0.0],
        "alpha_end": [5.0, 0.0, -5.0],
    },
}


@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("degrees", [10, 90, 150, 172, 178, 179.9])
@pytest.mark.parametrize("seed", range(3))
def test_large_steps_are_reached(ends, degrees, seed):
    keys, times = walk(30, np.radians(degrees), seed), np.arange(30.0)
    assert_interpolates_smoothly(C2(keys=keys, times=times, **ENDS[ends]), keys, times)


@pytest.mark.parametrize("place", [0, 500, 1000, 1980])
def test_a_path_that_folds_back_in_a_long_system_is_followed_by_itself(place):
    folds = walk(20, np.radians(178), 13)
    steps = rotation.between(walk(2000, 1.5)[:-1], walk(2000, 1.5)[1:])
    spans = np.ones(1999)
    steps[place : place + 19] = rotation.between(folds[:-1], folds[1:])
    spans[place : place + 19] = np.random.default_rng(13).uniform(0.2, 2.0, 20)[1:]
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in steps:
        keys.append(rotation.normalize(rotation.multiply(keys[-1], step)))
    keys, times = np.array(keys), np.cumsum(np.append(0.0, spans))
    whole = C2(keys=keys, times=times)
    assert_interpolates_smoothly(whole, keys, times)
    begin = max(place - 100, 0)
    alone = C2(keys=keys[begin : begin + 220], times=times[begin : begin + 220]).increments
    inner = slice(60 if begin else 0, -60 if begin + 220 < 2000 else None)
    assert np.abs(alone - whole.increments[begin : begin + 222][: len(alone)])[inner].max() < 1e-12


@pytest.mark.parametrize("start", ENDS)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("count", [2, 3, 4])
def test_every_pair_of_end_conditions_goes_with_few_keyframes(start, end, count):
    keys, times = walk(count, 0.8, seed=4), np.cumsum([1.0, 0.7, 1.3, 0.9])[:count]
    given = {key: value for key, value in ENDS[start].items() if "start" in key}
    given |= {key: value for key, value in ENDS[end].items() if "end" in key}
    curve = C2(keys=keys, times=times, **given)
    assert_interpolates_smoothly(curve, keys, times)
    _, omega, alpha = curve.evaluate(times[[0, -1]])
    for place, (condition, side) in enumerate(((start, "start"), (end, "end"))):
        if condition == "natural":
            assert alpha[place] == pytest.approx(np.zeros(3), abs=1e-11)
        else:
            assert omega[place] == pytest.approx(given[f"omega_{side}"], abs=1e-12)
        if condition == "state":
            assert alpha[place] == pytest.approx(given[f"alpha_{side}"], abs=1e-10)


def test_turns_are_whole_turns_about_the_step():
    keys = rotation.from_axis_angle([0.0, 0.0, 1.0], np.array([0.0, 0.5, 1.0]))
    curve = C2(keys=keys, times=[0.0, 1.0, 2.0], turns=[1, -2])
    times = np.linspace(0.0, 2.0, 20001)
    q, omega, _ = curve.evaluate(times)
    angle = np.sum(0.5 * (omega[1:, 2] + omega[:-1, 2]) * np.diff(times))
    assert angle == pytest.approx(1.0 + (1 - 2) * 2 * np.pi, abs=1e-6)
    at_middle = np.sum(0.5 * (omega[1:10001, 2] + omega[:10000, 2])) * times[1]
    assert at_middle == pytest.approx(0.5 + 2 * np.pi, abs=1e-6)
    assert rotation.angle(q[[0, 10000, 20000]], keys).max() < 1e-13
    assert np.sum(q[1:] * q[:-1], axis=1).min() > 0.99


def test_a_search_that_does_not_arrive_says_so():
    # A tenth of a millisecond for two radians asks for thousands of turns in its neighbours.
    with pytest.raises(PlanError, match="no spline of order 4 was found"):
        C2(keys=walk(5, 2.0, seed=1), times=np.cumsum([0.0, 1.0, 1e-4, 1.0, 1.0]))


def test_every_whole_turn_is_made_however_many_there_are():
    random = np.random.default_rng(3)
    for seed in range(40):
        count = int(random.integers(2, 6))
        keys = walk(count, random.uniform(0.1, 2.0), seed)
        turns = random.integers(-4, 5, count - 1)
        times = np.concatenate([[0.0], np.cumsum(random.uniform(0.5, 3.0, count - 1))])
        curve = C2(keys=keys, times=times, turns=turns.tolist())
        turned = np.diff(curve.trajectory.turned(times))
        assert np.all(turned > np.pi * (2 * np.abs(turns) - 1))
