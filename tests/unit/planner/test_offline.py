"""Planning from Python without a daemon: what is given, and what is refused."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import orientd
from orientd.errors import RequestError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest

KEYS = Rotation.from_rotvec([[0, 0, 0], [0, 0.2, 0.5], [0.3, 0, 1]])


@pytest.mark.parametrize(
    ("given", "field", "problem"),
    [
        ({"turns": [1]}, "turns", "expected 2, one for each interval, got 1"),
        ({"turns": 1}, "turns", "expected 2, one for each interval, got 1"),
        (
            {"turns": [0, 0.5]},
            "keyframes[2].turns",
            "expected a whole number, got 0.5; give a number such as 2",
        ),
        ({"times": 5}, "times", "expected 3, one for each keyframe, got 5"),
        ({"times": [0, 1]}, "times", "expected 3, one for each keyframe, got 2"),
        (
            {"positions": [1, 2, 3]},
            "keyframes[0].position",
            "expected three numbers, got 1; write them as [x, y, z]",
        ),
    ],
)
def test_a_column_that_does_not_fit_is_named_with_what_came(given, field, problem):
    with pytest.raises(RequestError) as caught:
        orientd.plan(KEYS, **given)
    assert (caught.value.field, caught.value.problem) == (field, problem)


def test_orientations_have_every_form_that_a_client_takes():
    named = [{"rotation_vector": one} for one in KEYS.as_rotvec()]
    assert np.abs(orientd.plan(named).request.keys - orientd.plan(KEYS).request.keys).max() < 1e-15
    assert len(orientd.plan(KEYS[1], start=orientd.plan(KEYS).start_state).request.keyframes) == 1


def test_no_keyframes_are_refused():
    with pytest.raises(RequestError, match="keyframes: expected at least 1, got 0"):
        orientd.plan([])


@pytest.mark.parametrize("given", [{"pace": 0.5}, {"times": [0, 1]}, {"turns": [1]}])
def test_nothing_that_stands_beside_a_whole_request_is_passed_over(given):
    request = MotionRequest([Keyframe((1, 0, 0, 0)), Keyframe((0.8, 0, 0, 0.6))])
    with pytest.raises(TypeError, match=f"a whole request has its own {next(iter(given))}"):
        orientd.plan(request, **given)


@pytest.mark.parametrize("number", [np.int64(1), np.float32(1.0), np.float64(1.0), 1])
def test_a_limit_may_be_a_number_of_any_kind(number):
    assert orientd.plan(KEYS, limits={"velocity": number}).limits.velocity == 1.0


@pytest.mark.parametrize("method", ["c2_cumulative", "squad"])
def test_a_limit_of_the_jerk_alone_is_enough(method):
    motion = orientd.plan(KEYS, method=method, limits=Limits.partial(jerk=50.0))
    assert 0.9 < motion.certificate.peak_jerk.planned_ratio <= 1.0


def test_keyframes_without_times_need_a_limit():
    with pytest.raises(RequestError, match=r"^limits: "):
        orientd.plan(KEYS, limits=Limits.partial())
    assert orientd.plan(KEYS, times=[0, 1, 2], limits=Limits.partial()).duration == 2.0


def test_a_motion_takes_times_of_any_shape():
    motion = orientd.plan(KEYS)
    times = np.linspace(0.0, motion.duration, 6).reshape(2, 3)
    turned = motion(times).as_rotvec().reshape(-1, 3)
    assert turned == pytest.approx(motion(times.reshape(-1)).as_rotvec(), abs=0.0)
    assert math.isclose(turned[-1, 2], 1.0)


def test_an_unknown_keyword_is_answered_as_an_unknown_key_of_a_file_is():
    with pytest.raises(RequestError, match=r"rate_hz: unknown key.*known are .*period"):
        orientd.plan(KEYS, rate_hz=1000)
    with pytest.raises(RequestError, match=r"limits\.max_velocity: .*did you mean 'velocity'"):
        orientd.plan(KEYS, limits={"max_velocity": 1.5})
    with pytest.raises(RequestError, match="limits: expected Limits or a mapping of velocity"):
        orientd.plan(KEYS, limits=(1.5, 6, 100))


def test_tab_shows_what_there_is():
    assert {"plan", "connect", "Quaternion", "curves", "OnTarget"} <= set(dir(orientd))
