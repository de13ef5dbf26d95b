"""Requests that are well formed and that nothing can be done about: refused, and soon."""

import math

import numpy as np
import pytest

from orientd.curves.interpolating import C2Cumulative
from orientd.curves.min_acceleration import MinAcceleration
from orientd.errors import LimitError, OrientdError, PlanError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner import planning
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing import even
from orientd.rotation import exp, multiply

THREE = ((1.0, 0.0, 0.0, 0.0), (0.8, 0.6, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0))
FOUR = (*THREE, (0.0, 0.0, 0.0, 1.0))
FAR = (None, (1e300, 0.0, 0.0), (-1e300, 1e-300, 0.0))
MOVES = (None, (1e-3, 0.0, 0.0), (1e-3, 0.0, 1e-9))


def planned(times=(None,) * 3, positions=(None,) * 3, period=0.002, **fields):
    keyframes = [
        Keyframe(q, time, position=position)
        for q, time, position in zip(THREE, times, positions, strict=True)
    ]
    start = State.at_rest(THREE[0], positions[0] or (0.0, 0.0, 0.0))
    request = MotionRequest(keyframes, **fields)
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=period)


def test_a_slow_device_can_be_stopped_within_24_s_and_its_motion_says_so():
    motion = planned(limits=Limits.partial(acceleration=0.001), period=0.02)
    assert motion.certificate.stop_time <= 24.0
    assert any(note.startswith("slower than its limits") for note in motion.certificate.notes)


def test_a_motion_whose_limits_permit_no_stop_within_24_s_is_no_longer_than_at_an_even_pace():
    limits = Limits.partial(jerk=1e-5)
    motion = planned(limits=limits, period=0.02)
    assert motion.duration < planned(limits=limits, pace="even", period=0.02).duration
    assert any(note.startswith("slower than its limits") for note in motion.certificate.notes)


def test_a_quickest_motion_gives_up_some_speed_to_be_stopped():
    limits = Limits.partial(acceleration=0.01)
    motion = planned(duration="minimum", limits=limits, period=0.02)
    assert motion.certificate.stop_time <= 24.0
    assert any(note.startswith("slower than its limits") for note in motion.certificate.notes)
    assert motion.duration < planned(limits=limits, pace="even", period=0.02).duration


@pytest.mark.parametrize("duration", [None, "minimum"])
@pytest.mark.parametrize(
    "limits",
    [
        {"velocity": 1e-9, "acceleration": 1e-6, "jerk": 1e-9},
        {"velocity": 1e-7},
        {"velocity": 2e-9, "acceleration": 8e-9},
    ],
)
def test_limits_that_would_take_days_are_refused_before_any_attempt(monkeypatch, limits, duration):
    measure = even.measure

    def looked_at(path, count, *given, **more):
        return measure(path, count, *given, **more) if count < 100 else pytest.fail("an attempt")

    monkeypatch.setattr(even, "measure", looked_at)
    monkeypatch.setattr(planning, "quickest", lambda *_, **__: pytest.fail("an attempt"))
    with pytest.raises(PlanError, match="at most 86400 s is planned"):
        planned(duration=duration, limits=Limits.partial(**limits))


@pytest.mark.parametrize(
    "fields",
    [
        {
            "limits": Limits.partial(velocity=1e-300, acceleration=1e-6, jerk=1e-12),
            "end_velocity": (1e-300, 0.0, 0.0),
            "duration": "minimum",
        },
        {"end_velocity": (1e300, -1e300, 0.0)},
        {"end_velocity": (1e300, -1e300, 0.0), "times": (0.0, 1.0, 2.0)},
        {"positions": FAR},
        {"limits": Limits.partial(linear_velocity=1e-320), "positions": MOVES},
        {"times": (0.0, 1e-300, 1.0)},
        {"times": (0.0, 1e-9, 86_000.0), "method": "minimum_effort"},
        {"times": (0.0, 1e-9, 86_000.0), "method": "min_acceleration"},
    ],
)
@pytest.mark.parametrize("approach", [False, True])
def test_numbers_out_of_all_proportion_are_refused_by_name(fields, approach):
    # Warnings are errors here.
    with pytest.raises(OrientdError):
        planned(**fields, approach=approach)


def test_intervals_too_short_for_any_clock_are_named():
    with pytest.raises(PlanError, match=r"\[2\] follows .*\[1\] after .* s, at least 1e-12 s"):
        planned(times=(-1.0, 0.0, 1e-13), approach=True)


@pytest.mark.parametrize("start", [None, (0.5, 0.0, 0.0)])
def test_a_curve_whose_acceleration_has_steps_comes_to_rest_at_them_and_says_so(start):
    motion = planned(method="kks_hermite_spline", start_velocity=start, approach=True)
    assert motion.certificate.notes[-1] == (
        "comes to rest 1 times on its way, where kks_hermite_spline is only C1; c2_cumulative is "
        "C2 and passes the same keyframes"
    )
    assert np.abs(motion.sample(motion.keyframe_times[1:2]).omega_body).max() < 1e-9


@pytest.mark.parametrize(
    ("last", "limits", "place"),
    [
        # An acceleration above its limit still rises for a record of the lead-out.
        (
            ((1.0, -0.2, 0.0), 1.9),
            {"acceleration": 2.0, "jerk": 100.0},
            r"the limit is 2 rad/s\^2; in the lead-out",
        ),
        (
            (None, 2.0),
            {"acceleration": 4.0},
            r"; between keyframes\[\d\] and keyframes\[\d\], at \d\.\d+ s of their time",
        ),
    ],
)
def test_the_place_of_a_broken_limit_is_named(last, limits, place):
    velocity, time = last
    slow = Limits.partial(**limits)
    with pytest.raises(LimitError, match=place):
        planned(times=(0.0, 1.0, time), approach=True, limits=slow, end_velocity=velocity)


def test_a_curve_of_too_many_pieces_is_refused_before_they_are_made():
    with pytest.raises(PlanError, match="more pieces than are tried"):
        MinAcceleration(keys=FOUR, times=[0.0, 1e-6, 1e6, 1e6 + 1.0])


def test_a_search_that_arrives_nowhere_ends():
    random = np.random.default_rng(5)
    keys = [np.array(THREE[0])]
    for axis in random.normal(size=(119, 3)):
        keys.append(multiply(keys[-1], exp(0.99 * math.pi * axis / np.linalg.norm(axis))))
    times = np.cumsum(10.0 ** random.uniform(-3.0, 0.0, 120))
    with pytest.raises(PlanError, match="no spline of order 4 was found"):
        C2Cumulative(keys=np.array(keys), times=times)
