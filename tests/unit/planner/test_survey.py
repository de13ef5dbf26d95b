import numpy as np
import pytest
from planned import LIMITS, rotations

from orientd.planner import Keyframe, MotionRequest, State, plan, survey
from orientd.planner.course import Course
from orientd.planner.methods import Ends, method_of
from orientd.planner.position import PositionPath
from orientd.planner.survey import Survey

ARM = LIMITS["arm"]
PERIOD = 0.002


def request(count=400, seed=9, **fields):
    q = rotations(np.random.default_rng(seed), count, 0.2)
    return MotionRequest([Keyframe(key) for key in q], **fields)


def core(asked, duration):
    times = np.linspace(0.0, 1.0, len(asked.keys))
    kept = np.arange(len(times))
    method = method_of(asked.method)
    return Course(asked, method, Ends(), times, kept, PositionPath.held(np.zeros(3))).core(duration)


@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline"])
def test_a_survey_tells_the_factor_of_all_records_and_where_it_comes_from(method):
    reserved = ARM.with_reserve()
    made = core(request(method=method), 100.0)
    found = Survey.of(made, reserved, PERIOD)
    everywhere = found.look(made, reserved, PERIOD, everywhere=True)
    assert found.factor == pytest.approx(everywhere, rel=0.02)
    assert found.look(made, reserved, PERIOD, everywhere=False) == pytest.approx(everywhere)
    assert (np.diff(found.spots.reshape(-1)) > 0.0).all()
    assert np.diff(found.spots, axis=1).sum() < 0.3


def test_spots_keep_their_places_when_the_duration_changes():
    reserved = ARM.with_reserve()
    made = core(request(), 100.0)
    slow = made.slowed(140.0)
    found = Survey.of(made, reserved, PERIOD)
    looks = [found.look(slow, reserved, PERIOD, everywhere=e) for e in (False, True)]
    assert looks[0] == pytest.approx(looks[1], rel=1e-3)


def test_a_peak_that_a_survey_has_missed_is_found_in_the_end(monkeypatch):
    asked = request()
    start = State.at_rest(asked.keys[0])
    right = plan(asked, start=start, limits=ARM, period=PERIOD)
    assert right.record_count > 4 * 8192

    def nowhere(core, limits, period, *, has_one_shape):
        return Survey(1.0, np.array([[0.0, 0.01]]))

    monkeypatch.setattr(survey.Survey, "of", staticmethod(nowhere))
    motion = plan(asked, start=start, limits=ARM, period=PERIOD)
    assert motion.duration == pytest.approx(right.duration, rel=2e-3)
    assert motion.certificate.peak_acceleration.ratio < 0.96
