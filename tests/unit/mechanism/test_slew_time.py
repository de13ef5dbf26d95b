"""Where an axis has to slew, it is where that takes the least time."""

import numpy as np
from gimbals import gimbal_of

from orientd.driver import AxisLimits
from orientd.mechanism.branches import candidates, choose
from orientd.mechanism.joint_path import Bounds
from orientd.mechanism.slews import with_stops


def test_of_all_slews_those_are_chosen_that_take_the_least_time():
    # Yaw must come back somewhere: by a whole turn, or by half a turn on the other branch.
    limits = [AxisLimits("yaw", -2.5, 4.0, 1.0, 40.0), *[AxisLimits("", -4.0, 4.0, 4.0, 40.0)] * 2]
    yaw = np.linspace(0.0, 6.0, 3001)
    principal = np.stack(
        [np.stack([yaw, 0 * yaw + 0.2, 0 * yaw], -1),
         np.stack([yaw - np.pi, 0 * yaw + np.pi - 0.2, 0 * yaw + np.pi], -1)], 1,
    )  # fmt: skip
    every = candidates(principal, limits)
    bounds, anywhere = Bounds(0.01, limits), np.ones(len(yaw), dtype=bool)
    found = choose(every, bounds, start=[0.0, 0.2, 0.0], slews=anywhere, stop=0.5)
    assert found.reached == len(yaw)
    stopped = with_stops(gimbal_of("ZYX"), found.joints, found.slews, bounds)
    # Half a turn of yaw at 1 rad/s with the others quicker, in place of a whole one.
    assert 0.01 * (len(stopped.joints) - 1) < 30.0 + 1.0 + np.pi + 0.1
