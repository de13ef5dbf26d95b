"""Whole passes of satellites on rotators of every kind, against the least time off target."""

import numpy as np
import pytest
from reference.pass_search import least_loss

import orientd
from emulated_dynamixel import ManualClock
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import rotate
from orientd_dynamixel import DynamixelDriver
from orientd_rotctld import satellite_pass

sky = pytest.importorskip("reference.sky", reason="needs sgp4", exc_type=ImportError)

PERIOD = 0.01
TOLERANCE = np.radians(0.5)
ACCELERATION = 60.0
LIMITS = DEFAULT_LIMITS.with_rates({"velocity": 1.5, "acceleration": 8.0, "jerk": 1500.0})
TURNS = [(0.0, 360.0), (0.0, 450.0), (-180.0, 180.0)]
HEIGHTS = [(0.0, 90.0), (0.0, 180.0)]
SPEEDS = [3.0, 5.0, 8.0, 12.0, 20.0, 30.0]


def rotator(turns, heights, speed):
    axes = [
        {"id": k + 1, "name": name, "limits_deg": list(range_), "velocity_deg": speed,
         "acceleration_deg": ACCELERATION}
        for k, (name, range_) in enumerate((("azimuth", turns), ("elevation", heights)))
    ]  # fmt: skip
    options = {"port": "virtual", "order": "ZY", "mount": {"w": 0, "x": 1, "y": 0, "z": 0},
               "allow_slews": True, "turns_file": "", "axes": axes}  # fmt: skip
    period_ns = round(PERIOD * 1e9)
    return DynamixelDriver(options, period_ns=period_ns, clock=ManualClock(1))


def planned(driver, request):
    joints = (0.0, 0.0)
    start = State.at_rest(driver.mechanism(may_ask=False).orientation(joints))
    planner = DevicePlanner(driver, limits=LIMITS, period=PERIOD)
    return planner.plan(request, start=start, joints=joints, is_offline=True)


@pytest.mark.timeout(7200)
@pytest.mark.parametrize("count", [3, pytest.param(50, marks=pytest.mark.bench)])
def test_passes_lose_hardly_more_than_the_least_time(count):
    rng, missed = np.random.default_rng(7), []
    for number, one in enumerate(sky.passes(count)):
        turns, speed = TURNS[rng.integers(3)], SPEEDS[rng.integers(6)]
        heights = HEIGHTS[int(number % 4 == 0)]
        request = satellite_pass(one.times, one.azimuth, one.elevation)
        motion = planned(rotator(turns, heights, speed), request)
        lost = sum(loss.end - loss.start for loss in motion.certificate.losses)
        plain = orientd.plan(request, period=PERIOD)
        fine = np.arange(0.0, one.times[-1], PERIOD)
        north, west, up = rotate(plain.sample(plain.start_time + fine).q, [1.0, 0.0, 0.0]).T
        least = least_loss(
            fine, np.unwrap(np.arctan2(-west, north)), np.arcsin(up), turns=np.radians(turns),
            inner=np.radians(heights), velocity=np.radians(speed),
            acceleration=np.radians(ACCELERATION), tolerance=TOLERANCE,
        )  # fmt: skip
        print(f"{number:2} {turns} {heights} {speed:4.0f} deg/s: {lost:7.2f} s, least {least:7.2f}")
        if lost > 1.05 * least + 2 * PERIOD:
            missed.append((number, lost, least))
    assert missed == []
