"""The planner refuses a motion at an end of travel if no slower one would stay inside it."""

import math

import pytest

from orientd.driver import AxisLimits
from orientd.errors import LimitError, LimitKind
from orientd.mechanism import Gimbal
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.fitting import Fitting
from orientd.planner.state import State

HERE = (1.0, 0.0, 0.0, 0.0)


def test_a_path_too_quick_that_ends_beyond_the_travel_is_refused_for_the_travel():
    axes = [
        AxisLimits("azimuth", -4.7, 4.7, 1.0, 3.5),
        AxisLimits("elevation", -3.1, 0.0, 1.0, 3.5),
    ]
    ways = [(0.0, 0.0), (0.7, -0.3), (1.0, 0.35)]
    keyframes = [
        Keyframe((
            math.cos(yaw / 2) * math.cos(pitch / 2),
            -math.sin(yaw / 2) * math.sin(pitch / 2),
            math.cos(yaw / 2) * math.sin(pitch / 2),
            math.sin(yaw / 2) * math.cos(pitch / 2),
        ))
        for yaw, pitch in ways
    ]  # fmt: skip
    request = MotionRequest(keyframes, approach=True)
    gimbal = Gimbal(axes, order="ZY", is_pointing=True)
    fitting = Fitting(gimbal, State.at_rest(HERE), (0.0, 0.0), DEFAULT_LIMITS, 0.01)
    with pytest.raises(LimitError, match="elevation reaches") as caught:
        fitting.plan(request)
    assert caught.value.kind is LimitKind.RANGE
