"""How long a keyframe path takes at its own pace, from its records."""

from dataclasses import replace

import numpy as np
import pytest
from planned import LIMITS, rotations
from reference.survey import coarse_factor, factor_of_records

from orientd.planner import DEFAULT_LIMITS, Keyframe, Limits, MotionRequest, State, plan
from orientd.planner.job import PlanJob
from orientd.planner.timing import even
from orientd.planner.timing.even import pace_of
from orientd.planner.timing.knots import Knots
from orientd.rotation import normalize

ARM = LIMITS["arm"]
PERIOD = 0.002


def request(count=400, seed=9, **fields):
    q = rotations(np.random.default_rng(seed), count, 0.2)
    return MotionRequest([Keyframe(key) for key in q], pace="even", **fields)


def keyframe_path(asked, duration, end_velocity=None):
    times = np.linspace(0.0, 1.0, len(asked.keys))
    asked = replace(asked, end_velocity=end_velocity)
    position = (0.0, 0.0, 0.0) if asked.positions is None else asked.positions[0]
    job = PlanJob.of(asked, State.at_rest(asked.keys[0], position), ARM, PERIOD)
    return job.path(Knots(times, np.arange(len(times))), duration)


def looked_at(path, limits, **options):
    """Return what the records say of a path in the duration that it has."""
    cycles = round(path.duration / PERIOD)
    fixed = {"first": cycles, "least": cycles, "most": cycles}
    return pace_of(path, limits, PERIOD, **fixed, **options)


@pytest.mark.parametrize("has_one_shape", [True, False])
@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline"])
def test_what_the_spots_say_is_what_all_records_say(method, has_one_shape):
    made = keyframe_path(request(method=method), 100.0)
    everywhere = looked_at(made, ARM.with_reserve(), everywhere=True)
    found = looked_at(made, ARM.with_reserve(), has_one_shape=has_one_shape)
    assert found.coarse == pytest.approx(everywhere.factor, rel=0.02)
    assert found.factor == pytest.approx(everywhere.factor)


def test_the_fewest_cycles_just_keep_the_limits():
    made, reserved = keyframe_path(request(), 100.0), ARM.with_reserve()
    cycles = pace_of(made, reserved, PERIOD, most=10**6).cycles
    assert 0.999 < looked_at(made.slowed(cycles * PERIOD), reserved).factor <= 1.0
    beyond = made.slowed(int(0.998 * cycles) * PERIOD)
    assert looked_at(beyond, reserved, everywhere=True).factor > 1.0


@pytest.mark.parametrize("most", [0, 1, 1000])
def test_cycles_that_are_too_few_are_not_found(most):
    made = keyframe_path(request(), 100.0)
    assert pace_of(made, ARM.with_reserve(), PERIOD, most=most).cycles == 0


def test_a_peak_that_the_spots_have_missed_is_found_in_the_end(monkeypatch):
    asked = request()
    start = State.at_rest(asked.keys[0])
    right = plan(asked, start=start, limits=ARM, period=PERIOD)
    assert right.record_count > 4 * 8192
    known = even.time_even

    def blind(*given):
        cycles, *rest = known(*given)
        return cycles // 2, *rest

    monkeypatch.setattr(even, "time_even", blind)
    motion = plan(asked, start=start, limits=ARM, period=PERIOD)
    # It may have less of the reserve then, but keeps the limits.
    assert motion.duration == pytest.approx(right.duration, rel=0.03)
    assert motion.certificate.peak_acceleration.planned_ratio <= 1.0


AXES = DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, AXES])
@pytest.mark.parametrize("count", [2, 5, 30, pytest.param(80, marks=pytest.mark.slow)])
@pytest.mark.parametrize("end_velocity", [None, (0.0, 0.2, 0.0)])
def test_the_kernel_says_what_numpy_says(limits, count, end_velocity):
    keys = np.array([4.0, 0.0, 0.0, 0.0]) + np.random.default_rng(count).normal(size=(count, 4))
    asked = MotionRequest([Keyframe(tuple(q)) for q in normalize(keys).tolist()])
    made = keyframe_path(asked, 1.4 * count, end_velocity)
    found = looked_at(made, limits, everywhere=True)
    assert found.coarse == pytest.approx(coarse_factor(made, limits, PERIOD), rel=1e-9)
    assert found.factor == pytest.approx(factor_of_records(made, limits, PERIOD), rel=1e-9)
    assert looked_at(made, limits).factor == pytest.approx(found.factor, rel=2e-3)


@pytest.mark.parametrize("limits", [ARM, Limits(2.5, 17.0, 300.0, 0.02, 0.1)])
def test_a_position_counts_as_its_differences(limits):
    random = np.random.default_rng(4)
    q = rotations(random, 6, 0.3)
    places = random.uniform(-0.2, 0.2, (6, 3))
    asked = MotionRequest(
        [Keyframe(key, position=tuple(place)) for key, place in zip(q, places, strict=True)]
    )
    made = keyframe_path(asked, 4.0)
    found = looked_at(made, limits, everywhere=True)
    # The reference looks at the last record, too, which is not a whole period behind the others.
    assert found.factor == pytest.approx(factor_of_records(made, limits, PERIOD), rel=1e-4)
    assert looked_at(made, limits).factor == pytest.approx(found.factor, rel=2e-3)
