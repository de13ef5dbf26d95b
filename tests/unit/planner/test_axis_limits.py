"""Limits of the body's axes, seen by an eye that shares no code with the planner."""

import math

import numpy as np
import pytest
from planned import PERIOD, anywhere, random_request, times_of
from reference.differences import certified
from scipy.spatial.transform import Rotation

from orientd.config.presets import PRESETS
from orientd.errors import LimitError, RequestError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp

SQUAT = Limits.partial(velocity=[1.0, 2.0, 0.6], acceleration=[3.0, 8.0, 2.0], jerk=[60, 200, 90])
UNEVEN = DEFAULT_LIMITS.narrowed(SQUAT)
HERE = (1.0, 0.0, 0.0, 0.0)


def components(q, period):
    """Return the components of velocity, acceleration and jerk from rest to rest, by SciPy."""
    q = np.concatenate([[q[0]] * 3, q, [q[-1]] * 3])
    rotation = Rotation.from_quat(q[:, [1, 2, 3, 0]])
    omega = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / period
    alpha = np.diff(omega, axis=0) / period
    return omega, alpha, np.diff(alpha, axis=0) / period


def assert_axes_kept(q, limits, tolerance=1e-6):
    for rate, name in zip(components(q, PERIOD), ("velocity", "acceleration", "jerk"), strict=True):
        assert np.all(np.abs(rate).max(axis=0) <= np.array(limits.axes(name)) * (1 + tolerance))


def test_three_numbers_limit_components_and_imply_the_norm():
    limits = Limits.partial(velocity=[2.0, 1.0, 2.0])
    assert limits.axis_velocity == (2.0, 1.0, 2.0)
    assert limits.velocity == 3.0
    assert limits.rate("velocity") == (2.0, 1.0, 2.0)
    assert limits.with_rates({"velocity": 5.0}).rate("velocity") == 5.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan])
def test_the_limit_of_an_axis_is_positive(wrong):
    with pytest.raises(ValueError, match=r"jerk (about y )?must be positive"):
        Limits.partial(jerk=[1.0, wrong, 1.0])


def test_a_request_lowers_single_axes_but_never_raises_them():
    device = DEFAULT_LIMITS.with_rates({"velocity": [2.0, 1.0, 3.0]})
    lowered = device.narrowed(Limits.partial(velocity=[1.0, 1.0, 3.0], jerk=[9.0, 8.0, 7.0]))
    assert lowered.axis_velocity == (1.0, 1.0, 3.0)
    assert lowered.axis_jerk == (9.0, 8.0, 7.0)
    with pytest.raises(RequestError, match=r"the device's 1 rad/s about y, got 1\.5") as caught:
        device.narrowed(Limits.partial(velocity=[1.0, 1.5, 1.0]))
    assert caught.value.field == "limits.velocity[1]"
    with pytest.raises(RequestError, match=r"the device's 2\.5 rad/s about z, got 3"):
        DEFAULT_LIMITS.narrowed(Limits.partial(velocity=[1.0, 1.0, 3.0]))


def test_limits_along_a_direction_are_those_of_its_tightest_axis():
    direction = np.array([0.6, 0.0, 0.8])
    velocity, acceleration, jerk = UNEVEN.along(direction.tolist())
    assert velocity == pytest.approx(min(1.0 / 0.6, 0.6 / 0.8))
    assert acceleration == pytest.approx(min(3.0 / 0.6, 2.0 / 0.8))
    assert jerk == pytest.approx(min(60 / 0.6, 90 / 0.8))


@pytest.mark.parametrize("seed", range(6))
def test_motions_with_leads_keep_the_limits_of_every_axis(seed):
    random = np.random.default_rng(seed)
    request = random_request(random, Limits.partial(velocity=0.5))
    motion = plan(request, start=anywhere(random), limits=UNEVEN, period=PERIOD)
    q = motion.sample(times_of(motion)).q
    assert_axes_kept(q, UNEVEN)
    # What is certified is what SciPy sees.
    peaks = {figure.name: figure.value for figure in motion.certificate.figures}
    for rate, name in zip(components(q, PERIOD), ("velocity", "acceleration", "jerk"), strict=True):
        for axis, largest in zip("xyz", np.abs(rate).max(axis=0), strict=True):
            certified = peaks[f"angular {name} about {axis}"]
            # Between the records somewhat more, of the jerk of curves without a fourth derivative.
            assert largest * (1 - 1e-6) <= certified <= 1.1 * largest


def test_times_of_the_users_are_refused_for_the_axis_they_are_too_fast_for():
    keyframes = [
        Keyframe(HERE, time=0.0),
        Keyframe((math.cos(0.5), 0.0, 0.0, math.sin(0.5)), time=1.6),
    ]
    request = MotionRequest(keyframes)
    plan(request, start=State.at_rest(HERE), limits=DEFAULT_LIMITS, period=PERIOD)
    with pytest.raises(LimitError) as caught:
        plan(request, start=State.at_rest(HERE), limits=UNEVEN, period=PERIOD)
    assert caught.value.quantity == "angular velocity about z"
    assert caught.value.limit == 0.6
    assert 0.0 < caught.value.time < 1.6


def test_an_end_velocity_beyond_an_axis_is_refused_before_anything_is_planned():
    keyframes = [Keyframe(HERE), Keyframe((0.6, 0.8, 0.0, 0.0))]
    request = MotionRequest(keyframes, end_velocity=(0.0, 0.0, 0.7))
    with pytest.raises(LimitError, match="angular velocity about z") as caught:
        plan(request, start=State.at_rest(HERE), limits=UNEVEN, period=PERIOD)
    assert "end_velocity asks for it" in str(caught.value)


def test_a_brake_rate_for_axes_is_that_for_a_norm_on_a_turn_about_one_of_them():
    times = PERIOD * np.arange(40)
    q = exp(np.outer(0.3 * np.sin(1.5 * times), [0.0, 1.0, 0.0]))
    alone = Limits.partial(acceleration=1.0, jerk=50.0)
    about_y = Limits.partial(acceleration=[1e9, 1.0, 1e9], jerk=[1e9, 50.0, 1e9])
    one, other = (certified(q, period=PERIOD, brake_limits=each) for each in (about_y, alone))
    assert (one.rate, one.rate_place) == (other.rate, other.rate_place)
    assert 0.0 < one.rate < 20.0


def test_a_stop_on_the_path_keeps_the_limits_of_every_axis():
    # The servo's own time scaling on the motion's own curve, at the worst moments.
    from orientd.servo.path.time_scaling import TimeScaling

    random = np.random.default_rng(7)
    motion = plan(
        random_request(random, UNEVEN), start=anywhere(random), limits=UNEVEN, period=PERIOD
    )
    for moment in np.linspace(0.05, 0.9, 23):
        clock = TimeScaling(PERIOD)
        clock.begin(motion.certificate.brake_rate, 1.0)
        cycles = int(moment * motion.record_count)
        times = list(PERIOD * np.arange(cycles))
        clock.target = 0.0
        while not clock.is_at_rest:
            times.append(times[-1] + PERIOD * clock.advance())
        assert_axes_kept(motion.sample(np.array(times)).q, UNEVEN, 1e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_can_be_planned_with_and_says_where_it_is_from(name):
    preset = PRESETS[name]
    assert len(preset.source) > 20
    request = MotionRequest([Keyframe(HERE), Keyframe((0.6, 0.8, 0.0, 0.0))])
    motion = plan(request, start=State.at_rest(HERE), limits=preset.limits, period=PERIOD)
    assert motion.certificate.peak_velocity.limit == preset.limits.velocity
