import math
from dataclasses import replace

import pytest

from orientd.errors import RequestError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

ARM = DEFAULT_LIMITS


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan])
def test_a_limit_is_positive(limit):
    with pytest.raises(ValueError, match="jerk must be positive"):
        Limits.partial(jerk=limit)


def test_whole_numbers_are_limits_too():
    limits = Limits(2, 10, 100, 1, 10, axis_velocity=(1, 2, 2))
    assert limits == Limits(2.0, 10.0, 100.0, 1.0, 10.0, axis_velocity=(1.0, 2.0, 2.0))
    keyframe = Keyframe((0.8, 0.6, 0.0, 0.0), position=(0.1, 0.0, 0.0))
    request, start = MotionRequest([keyframe], approach=True), State.at_rest((1.0, 0.0, 0.0, 0.0))
    assert plan(request, start=start, limits=limits, period=0.002).duration > 0.0


def test_a_limit_of_the_norm_is_one_number():
    with pytest.raises(TypeError, match=r"acceleration must be a number, got \(17, 12, 20\)"):
        Limits(2.5, (17, 12, 20), 40.0, 1.0, 1.0)


def test_a_request_lowers_the_limits_it_names_and_no_others():
    lowered = ARM.narrowed(Limits.partial(velocity=1.0))
    assert lowered == replace(ARM, velocity=1.0)
    assert ARM.narrowed(None) is ARM


def test_a_request_cannot_raise_a_limit():
    with pytest.raises(RequestError, match=r"at most the device's 17 rad/s\^2, got 18") as caught:
        ARM.narrowed(Limits.partial(acceleration=18.0))
    assert caught.value.field == "limits.acceleration"


def test_the_reserve_leaves_velocities_alone():
    reserved = ARM.with_reserve()
    assert (reserved.velocity, reserved.linear_velocity) == (ARM.velocity, ARM.linear_velocity)
    assert reserved.acceleration == pytest.approx(0.95 * ARM.acceleration)
    assert reserved.jerk == pytest.approx(0.95 * ARM.jerk)
    assert reserved.linear_acceleration == pytest.approx(0.95 * ARM.linear_acceleration)
