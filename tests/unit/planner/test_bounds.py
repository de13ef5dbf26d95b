"""Certificates against what is found at random phases and rates, by the servo's law."""

import functools
import os

import numpy as np
import pytest
from reference.differences import certified as extremes
from reference.differences import differences

from orientd.errors import OrientdError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.facts import HISTORY
from orientd.planner.planning import plan
from orientd.planner.recorded import states_between
from orientd.planner.state import State
from orientd.rotation import exp, multiply

CASES = int(os.environ.get("ORIENTD_CASES", "40000"))
MOTIONS = 80
METHODS = ["c2_cumulative", "squad", "kks_hermite_spline", "bezier_catmull_rom", "piecewise_slerp"]
LIMITS = [
    DEFAULT_LIMITS,
    Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    Limits(10.0, 200.0, 3e4, 3.0, 30.0),
    Limits(1.0, 6.0, 300.0, 0.5, 5.0, axis_velocity=(0.8, 1.0, 0.6)),
]


def request_of(random, number):
    steps = exp(random.uniform(0.05, 0.8) * random.normal(size=(int(random.integers(1, 5)), 3)))
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in steps:
        keys.append(multiply(keys[-1], step))
    pace = [None, "even"][number % 2]
    return MotionRequest(
        [Keyframe(tuple(key)) for key in keys],
        method=METHODS[number % len(METHODS)],
        approach=True,
        pace=pace,
    )


@functools.cache
def certified():
    """Return records of motions with those held before and behind, periods, and their bounds."""
    random, found, number = np.random.default_rng(5), [], 0
    while len(found) < MOTIONS:
        number += 1
        period, limits = [0.01, 0.004, 0.002][number % 3], LIMITS[number % len(LIMITS)]
        start = State.at_rest([1.0, 0.0, 0.0, 0.0])
        try:
            request = request_of(random, number)
            motion = plan(request, start=start, limits=limits, period=period)
        except OrientdError:
            continue
        if motion.record_count > 3000:
            continue
        rows = motion.records(0, motion.record_count)[:, :10]
        rows = np.concatenate(
            [np.repeat(rows[:1], 3, axis=0), rows, np.repeat(rows[-1:], 3, axis=0)]
        )
        rows[:HISTORY, 4:] = rows[-HISTORY:, 4:] = 0.0
        bounds = extremes(rows, period=period, brake_limits=limits, with_axes=limits.has_axes)
        found.append((rows, period, np.sqrt(bounds.largest[:3])))
    return found


def rates_at(rows, period, places, rate):
    """Return the three backward differences of setpoints that end at places among records."""
    places = places[:, None] - rate[:, None] * np.arange(HISTORY, -1, -1)
    record = np.clip(places.astype(np.int64), 0, len(rows) - 2).ravel()
    states = states_between(rows[record], rows[record + 1], period, places.ravel() - record)
    q = states[:, :4].reshape(-1, HISTORY + 1, 4)
    found = [differences(np.ascontiguousarray(each)) for each in np.swapaxes(q, 0, 1)[None]]
    return [part[-1] for part in found[0]]


def columns_of(rates):
    """Return the norm and the components of differences, shape ``(n, 4)``."""
    return np.concatenate([np.linalg.norm(rates, axis=1)[:, None], np.abs(rates)], axis=1)


def test_nothing_is_above_its_certificate_at_any_phase_and_rate():
    random = np.random.default_rng(8)
    each = -(-CASES // MOTIONS)
    for rows, period, bounds in certified():
        places = random.uniform(HISTORY, len(rows) - 1, each)
        # Most of them near the rate of the plan, where the differences are largest.
        rate = 1.0 - random.uniform(size=each) ** 3 * (random.uniform(size=each) < 0.7)
        for rates, bound in zip(rates_at(rows, period, places, rate), bounds, strict=True):
            largest = columns_of(rates).max(axis=0)[bound > 0.0]
            assert np.all(largest <= bound[bound > 0.0] * (1.0 + 1e-6) + 5e-14)


def test_a_certificate_is_hardly_above_what_is_reached():
    for rows, period, bounds in certified():
        records = np.arange(HISTORY, len(rows) - 1.0)
        best = np.zeros((3, 4))
        for phase in np.linspace(0.0, 1.0, 32, endpoint=False):
            found = rates_at(rows, period, records + phase, np.ones(len(records)))
            best = np.maximum(best, [columns_of(rates).max(axis=0) for rates in found])
        # A component that is far below the norm may have a bound that is too dear to refine.
        is_wanted = (bounds > 0.0) & (bounds >= 0.7 * bounds[:, :1])
        assert np.all(bounds[is_wanted] <= 1.005 * best[is_wanted] + 5e-14)


@pytest.mark.parametrize("turn", [0.6, 1.5])
def test_a_period_that_turns_far_is_told_to_be_sampled(turn):
    times = np.arange(20.0)
    axis = np.array([0.6, 0.0, 0.8])
    rows = np.zeros((20, 10))
    rows[:, :4] = exp(turn * times[:, None] * axis)
    rows[:, 4:7] = turn * axis
    found = extremes(rows, brake_limits=DEFAULT_LIMITS)
    assert found.unproven == 19
    assert np.sqrt(found.largest[0][0]) == pytest.approx(turn, rel=1e-12)


def test_what_is_not_a_number_is_the_largest_difference():
    q = exp(np.linspace(0.0, 1.0, 40)[:, None] * np.ones(3))
    q[20] = np.nan
    assert np.isnan([row[0] for row in extremes(q).largest]).all()


@pytest.mark.parametrize("angle", [1e-12, 1e-4, 0.0624, 0.0625, 0.0626, 1.0, 3.0])
def test_differences_are_those_of_turns_of_any_size(angle):
    rng = np.random.default_rng(1)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = multiply(exp(rng.normal(size=3)), exp(angle * np.arange(5)[:, None] * axis))
    q *= rng.choice([-1.0, 1.0], 5)[:, None]
    found = extremes(q, with_axes=True)
    sizes = np.sqrt(found.largest[0])
    assert sizes == pytest.approx(angle * np.array([1.0, *np.abs(axis)]), rel=1e-12, abs=1e-15)
    assert np.sqrt(found.largest[1:3]).max() <= 1e-15 + 1e-14 * angle
