from unittest.mock import Mock

import numpy as np
import pytest
from planned import LIMITS, rotations
from reference import differences as reference
from reference.survey import surveyed

from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State, plan
from orientd.planner.certify import measuring
from orientd.planner.methods import Ends
from orientd.planner.path.position import PositionPath
from orientd.planner.timing import survey
from orientd.planner.timing.candidate_path import PathRequest
from orientd.planner.timing.survey import Survey
from orientd.planner.timing.timing import excess
from orientd.rotation import normalize

ARM = LIMITS["arm"]
PERIOD = 0.002


def request(count=400, seed=9, **fields):
    q = rotations(np.random.default_rng(seed), count, 0.2)
    return MotionRequest([Keyframe(key) for key in q], pace="even", **fields)


def keyframe_path(asked, duration, end_velocity=None):
    times = np.linspace(0.0, 1.0, len(asked.keys))
    kept = np.arange(len(times))
    ends = Ends(None, end_velocity, None)
    return PathRequest(asked, ends, times, kept, PositionPath.held(np.zeros(3))).keyframe_path(
        duration
    )


@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline"])
def test_a_survey_tells_the_factor_of_all_records_and_where_it_comes_from(method):
    reserved = ARM.with_reserve()
    made = keyframe_path(request(method=method), 100.0)
    found = Survey.of(made, reserved, PERIOD)
    everywhere = found.look(made, reserved, PERIOD, everywhere=True)
    assert found.factor == pytest.approx(everywhere, rel=0.02)
    assert found.look(made, reserved, PERIOD, everywhere=False) == pytest.approx(everywhere)
    assert (np.diff(found.spots.reshape(-1)) > 0.0).all()
    assert np.diff(found.spots, axis=1).sum() < 0.3


def test_spots_keep_their_places_when_the_duration_changes():
    reserved = ARM.with_reserve()
    made = keyframe_path(request(), 100.0)
    slow = made.slowed(140.0)
    found = Survey.of(made, reserved, PERIOD)
    looks = [found.look(slow, reserved, PERIOD, everywhere=e) for e in (False, True)]
    assert looks[0] == pytest.approx(looks[1], rel=1e-3)


def test_a_peak_that_a_survey_has_missed_is_found_in_the_end(monkeypatch):
    asked = request()
    start = State.at_rest(asked.keys[0])
    right = plan(asked, start=start, limits=ARM, period=PERIOD)
    assert right.record_count > 4 * 8192

    surveyed = []

    def nowhere(keyframe_path, limits, period, *, has_one_shape):
        surveyed.append(keyframe_path)
        return Survey(1.0, np.array([[0.0, 0.01]]))

    monkeypatch.setattr(survey.Survey, "of", staticmethod(nowhere))
    motion = plan(asked, start=start, limits=ARM, period=PERIOD)
    # Missed the first time, when nothing but that spot is looked at.
    assert len(surveyed) == 2
    assert motion.duration == pytest.approx(right.duration, rel=2e-3)
    assert motion.certificate.peak_acceleration.ratio < 0.96


AXES = DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})


@pytest.mark.parametrize("limits", [DEFAULT_LIMITS, AXES])
@pytest.mark.parametrize("count", [2, 5, 30, pytest.param(80, marks=pytest.mark.slow)])
@pytest.mark.parametrize("end_velocity", [None, (0.0, 0.2, 0.0)])
def test_a_survey_says_what_numpy_says(monkeypatch, limits, count, end_velocity):
    keys = np.array([4.0, 0.0, 0.0, 0.0]) + np.random.default_rng(count).normal(size=(count, 4))
    asked = MotionRequest([Keyframe(tuple(q)) for q in normalize(keys).tolist()])
    made = keyframe_path(asked, 1.4 * count, end_velocity and np.array(end_velocity))
    found = Survey.of(made, limits, PERIOD, has_one_shape=True)
    factor, spots = surveyed(made, limits, PERIOD)
    assert found.factor == pytest.approx(factor, rel=1e-12)
    assert found.spots.reshape(-1) == pytest.approx(spots.reshape(-1), rel=1e-12)
    everywhere = found.look(made, limits, PERIOD, everywhere=True)
    here = found.look(made, limits, PERIOD, everywhere=False)
    plainly = Mock(wraps=reference.extremes)
    monkeypatch.setattr(measuring, "extremes", plainly)
    assert everywhere == pytest.approx(excess(made.peaks(PERIOD, limits), 2), rel=1e-12)
    assert plainly.called
    assert here == pytest.approx(everywhere, rel=2e-3)
