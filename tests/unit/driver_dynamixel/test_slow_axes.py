"""Antenna rotators: axes that turn slowly, but reach their full rate within a few cycles."""

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import from_euler
from orientd_dynamixel import DynamixelDriver
from orientd_rotctld import satellite_pass

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)


class Rotator:
    """Azimuth and elevation, with a velocity in degrees a second."""

    def __init__(self, velocity, period, *, azimuth=(0, 360), elevation=(0, 90)):
        axes = [
            {"id": number, "name": name, "limits_deg": list(limits), "velocity_deg": velocity,
             "acceleration_deg": 60}
            for number, (name, limits) in enumerate(
                (("azimuth", azimuth), ("elevation", elevation)), 1
            )
        ]  # fmt: skip
        options = {"port": "virtual", "order": "ZY", "mount": {"w": 0, "x": 1, "y": 0, "z": 0},
                   "allow_slews": True, "turns_file": "", "axes": axes}  # fmt: skip
        driver = DynamixelDriver(options, period_ns=round(1e9 * period), clock=ManualClock(1))
        self.mechanism = driver.mechanism(may_ask=False)
        self._planner = DevicePlanner(driver, limits=LIMITS, period=period)

    def plan(self, request, joints, start=None, **state):
        """Plan from axis angles, rad; at rest unless there is a state."""
        start = start or State.at_rest(self.mechanism.orientation(joints))
        return self._planner.plan(request, start=start, joints=joints, is_offline=True, **state)

    def move(self, begin_deg, end_deg):
        """Plan a move between two pairs of axis angles, degrees."""
        goal = self.mechanism.orientation(tuple(np.radians(end_deg)))
        return self.plan(MotionRequest([Keyframe(goal)]), tuple(np.radians(begin_deg)))


@pytest.mark.parametrize("period", [0.1, 0.02, pytest.param(0.01, marks=pytest.mark.slow)])
@pytest.mark.parametrize("velocity", [3.0, 8.0, 30.0])
def test_a_move_takes_the_slowest_axis_little_longer_than_its_way(velocity, period):
    """It neither stops on its way nor takes the longer one."""
    rotator, random = Rotator(velocity, period), np.random.default_rng(1)
    for _ in range(10):
        begin, end = random.uniform([5.0, 5.0], [355.0, 80.0], (2, 2))
        if abs(end[0] - begin[0]) > 150.0:
            continue
        motion = rotator.move(begin, end)
        way = np.max(np.abs(end - begin))
        assert np.degrees(motion.path.joints[-1]) == pytest.approx(end, abs=0.05)
        assert motion.duration < 1.3 * way / velocity + 10.0 * period + 0.5


@pytest.mark.parametrize("period", [0.1, 0.01])
def test_a_move_from_the_end_of_a_range_does_not_unwind(period):
    """To unwind would take minutes."""
    motion = Rotator(3.0, period).move((0.0, 0.0), (103.0, 31.0))
    assert motion.duration < 103.0 / 3.0 + 1.5
    assert not motion.certificate.losses


def test_a_moving_device_is_stopped_rather_than_led_astray():
    """At low speed the axes could leave for a detour of five minutes without a stop."""
    rotator = Rotator(3.0, 0.1)
    first, second = (
        MotionRequest([Keyframe(from_euler("ZY", np.radians([azimuth, -30.0])))], approach=True)
        for azimuth in (-100.0, -101.0)
    )
    motion = rotator.plan(first, (0.0, 0.0))
    with pytest.raises(PlanError, match="stop first"):
        rotator.plan(
            second,
            motion.recorded().joints_at(1),
            start=motion.state_at(1),
            before=motion.path.joints_before(1),
            rates=motion.recorded().joint_rates_at(1),
        )


@pytest.mark.parametrize("period", [0.1, 0.02])
@pytest.mark.parametrize(("velocity", "highest"), [(3.0, 89.1), (3.0, 89.7), (8.0, 89.5)])
def test_a_pass_near_the_zenith_is_planned(velocity, highest, period):
    """The corners between the target and the slews keep the limits between two cycles too."""
    times = np.arange(0.0, 700.0, 8.0)
    along = 7.0 * (times - 350.0)
    aside, above = 500.0 / np.tan(np.radians(highest)), 500.0 - along**2 / 13000.0
    azimuth = np.degrees(np.arctan2(aside, along)) % 360.0
    elevation = np.degrees(np.arctan2(above, np.hypot(along, aside)))
    is_up = elevation > 0.0
    request = satellite_pass(times[is_up] - times[is_up][0], azimuth[is_up], elevation[is_up])
    motion = Rotator(velocity, period, azimuth=(-180, 180)).plan(request, (0.0, 0.0))
    lost = sum(loss.end - loss.start for loss in motion.certificate.losses)
    assert 0.0 < lost < 180.0 / velocity
