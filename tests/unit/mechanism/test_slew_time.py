"""Where an axis has to slew, it is where that takes the least time."""

import numpy as np
import pytest
from gimbals import forward, gimbal_of, inverse

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


def winding(turns, seed=4):
    """Return both branches of a path that winds about all axes, and crosses the pole."""
    t = np.linspace(0.0, 1.0, 1500)
    wander = np.random.default_rng(seed).normal(size=(3, 4))
    ways = [np.polynomial.Polynomial(row)(t) for row in wander]
    yaw, pitch, roll = (way + 2 * np.pi * turns * t for way in ways)
    gimbal = gimbal_of("ZYX")
    return inverse(gimbal, forward(gimbal, np.stack([yaw, pitch, roll], axis=-1)))


@pytest.mark.parametrize("turns", [pytest.param(0, marks=pytest.mark.slow), 3])
def test_the_number_of_candidates_does_not_grow_with_the_limits(turns):
    principal, found = winding(turns), []
    anywhere = np.ones(len(principal), dtype=bool)
    start = principal[0, 0]
    for most in (10 + turns, 40, 255):
        limits = [AxisLimits(name, *(2 * np.pi * most * np.array([-1, 1])), 3.0, 30.0)
                  for name in ("yaw", "pitch", "roll")]  # fmt: skip
        every = candidates(principal, limits, start)
        assert every.shape[1] <= 2 * 3**3
        choice = choose(every, Bounds(0.01, limits), start=start, slews=anywhere, stop=0.5)
        assert choice.reached == len(principal)
        found.append(choice)
    assert all(np.array_equal(one.joints, found[0].joints) for one in found)
    assert all(one.slews == found[0].slews for one in found)


@pytest.mark.parametrize("turns", [-3, 3])
def test_a_middle_axis_may_wind_on_the_branch_that_does_not_begin_near_zero(turns):
    # The branch near zero has yaw beyond its limit, and pitch winds the other way there.
    limits = [AxisLimits("yaw", -1.5, 1.5, 3.0, 30.0), AxisLimits("pitch", -30.0, 30.0, 3.0, 30.0),
              AxisLimits("roll", -4.5, 0.3, 3.0, 30.0)]  # fmt: skip
    pitch = -2.3 + 2 * np.pi * turns * np.linspace(0.0, 1.0, 2000)
    asked = np.stack([0 * pitch - 0.1, pitch, 0 * pitch - 3.1], axis=-1)
    gimbal = gimbal_of("ZYX")
    every = candidates(inverse(gimbal, forward(gimbal, asked)), limits)
    assert np.all(np.nanmin(np.max(np.abs(every - asked[:, None]), axis=-1), axis=1) < 1e-9)


def test_where_no_turn_has_the_whole_path_every_turn_is_a_candidate():
    # Three turns of yaw within two: it must unwind, and may choose by how many turns.
    limits = [AxisLimits("yaw", -7.0, 7.0, 3.0, 30.0),
              *[AxisLimits(name, -4.0, 4.0, 3.0, 30.0) for name in ("pitch", "roll")]]  # fmt: skip
    yaw = np.linspace(0.0, 19.0, 2000)
    principal = np.stack(
        [np.stack([yaw, 0 * yaw + 0.2, 0 * yaw], -1),
         np.stack([yaw - np.pi, 0 * yaw + np.pi - 0.2, 0 * yaw + np.pi], -1)], 1,
    )  # fmt: skip
    principal -= 2 * np.pi * np.ceil((principal - np.pi) / (2 * np.pi))
    every = candidates(principal, limits)
    for row, angles in zip(every[::50], principal[::50], strict=True):
        within = {
            round(float(angle), 6)
            for angle in (angles[:, 0, None] + 2 * np.pi * np.arange(-4, 5)).ravel()
            if abs(angle) <= 7.0
        }
        assert {round(float(one), 6) for one in row[:, 0] if one == one} == within
