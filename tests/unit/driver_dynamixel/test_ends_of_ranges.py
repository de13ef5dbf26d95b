"""The ends of the axes' ranges: less than the device resolves is not outside."""

import math

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd.driver import Setpoint
from orientd.errors import DeviceFaultError, LimitError
from orientd.model.limits import Limits
from orientd.planner.device_planner import DevicePlanner
from orientd_dynamixel import DynamixelDriver
from orientd_rotctld import satellite_pass

TICK = 2 * np.pi / 4096
EARTH, HEIGHT, RATE = 6371.0, 500.0, 1.107e-3
"""Of the earth and of a circular orbit, km and rad/s."""


def rotator():
    turn = {"velocity_deg": 6, "acceleration_deg": 30}
    axes = [
        {"id": 1, "name": "azimuth", "limits_deg": [0, 450], **turn},
        {"id": 2, "name": "elevation", "limits_deg": [0, 90], **turn},
    ]
    options = {"port": "virtual", "order": "ZY", "axes": axes}
    options["mount"] = {"w": 0.0, "x": 1.0, "y": 0.0, "z": 0.0}
    return DynamixelDriver(options, period_ns=20_000_000, clock=ManualClock(1))


def satellite(times, highest):
    """Return unit vectors to a satellite, north, east and up, that culminates at 0 s."""
    radius, peak = EARTH + HEIGHT, np.radians(highest)
    aside = np.arccos(EARTH * np.cos(peak) / radius) - peak
    turn = RATE * times
    seen = np.stack([
        radius * np.sin(turn),
        np.full_like(turn, radius * np.sin(aside)),
        radius * np.cos(aside) * np.cos(turn) - EARTH,
    ])  # fmt: skip
    return seen / np.linalg.norm(seen, axis=0)


def from_horizon(highest, late):
    """Return a pass that begins *late* seconds after the rise."""
    fine = np.arange(-400.0, 0.0, 1e-3)
    rise = fine[np.argmax(satellite(fine, highest)[2] > 0.0)]
    times = np.arange(rise + late, -rise, 1.0)
    north, east, up = satellite(times, highest)
    azimuth = np.degrees(np.unwrap(np.arctan2(east, north)))
    azimuth -= 360.0 * np.floor(azimuth.min() / 360.0)
    return satellite_pass(times - times[0], azimuth, np.degrees(np.arcsin(up)))


@pytest.mark.parametrize("late", [0.0025, 0.0075])
@pytest.mark.parametrize("highest", [10, 60])
def test_a_pass_from_the_horizon_is_planned_on_an_elevation_that_ends_there(highest, late):
    planner = DevicePlanner(rotator(), limits=Limits(1.0, 3.0, 300.0, 1.0, 10.0), period=0.02)
    motion = planner.plan_offline(from_horizon(highest, late))
    assert motion.path.joints[:, 1].min() > -TICK


def test_a_path_further_outside_is_refused():
    planner = DevicePlanner(rotator(), limits=Limits(1.0, 3.0, 300.0, 1.0, 10.0), period=0.02)
    with pytest.raises(LimitError, match="angle of elevation"):
        planner.plan_offline(from_horizon(30, -10.0))


def test_a_servo_gets_no_goal_beyond_the_range_of_its_axis(rig):
    axes = [{"id": 1, "limits_deg": [0, 90]}, {"id": 2, "limits_deg": [-90, 0]}]
    it = rig("ZY", axes=axes)
    it.start()
    for beyond in (0.0, 0.6 * TICK, TICK):
        it.cycle([-beyond, beyond])
        assert it.goals() == [2048, 2048]
    with pytest.raises(DeviceFaultError, match=r"allowed are 0\.00 to 90\.00 deg"):
        it.driver.write(Setpoint(it.next_ns, it.q, joints=(np.radians(-1.0), 0.0)))


def test_a_coarse_servo_is_enabled_within_a_tick_of_the_end_of_its_range(rig):
    axes = [{"id": 1, "limits_deg": [-90, 90], "gear": 0.1}, {"id": 2, "limits_deg": [-90, 90]}]
    it = rig("ZY", axes=axes)
    for ticks, is_within in ((103, True), (104, False)):
        it.servo(1).shaft.position = 2048 + ticks
        it.driver.open()
        if is_within:
            assert math.degrees(it.enable().joints[0]) == pytest.approx(90.5, abs=0.1)
            it.driver.disable()
            it.driver.free()
        else:
            with pytest.raises(DeviceFaultError, match=r"would be at 91\.4\d deg"):
                it.driver.enable()
