"""A gimbal is slow where its axes need it, and a refusal names the duration that would do."""

import re

import numpy as np
import pytest

from orientd import motion_file
from orientd.clock import ManualClock
from orientd.errors import LimitError
from orientd.planner import DevicePlanner, Limits, State
from orientd.rotation import angle, rotate
from orientd_dynamixel import DynamixelDriver

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
AXES = [
    {"id": k + 1, "name": name, "limits_deg": [-270, 270], "velocity_deg": 220}
    for k, name in enumerate(("yaw", "pitch", "roll"))
]


def planned(mapping, order="ZYX", axes=AXES):
    driver = DynamixelDriver(
        {"port": "virtual", "order": order, "axes": axes[: len(order)]},
        period_ns=10_000_000, clock=ManualClock(1),
    )  # fmt: skip
    start = State.at_rest([1.0, 0.0, 0.0, 0.0])
    planner = DevicePlanner(driver, limits=LIMITS, period=0.01)
    return planner.plan(motion_file.parse(mapping), start=start, joints=(0.0,) * len(order))


def over_the_top(miss_deg):
    miss = np.deg2rad(miss_deg)
    axis = np.array([0, -np.cos(miss), np.sin(miss)])
    sweeps = np.deg2rad(np.linspace(0, 150, 7))
    return {"keyframes": [{"rotation_vector": (s * axis).tolist()} for s in sweeps],
            "approach": True}  # fmt: skip


@pytest.mark.parametrize(("miss", "longest"), [(0.1, 12.0), (1.0, 5.5), (2.0, 4.8)])
def test_passage_by_the_pole_is_slow_there_and_nowhere_else(miss, longest):
    motion = planned(over_the_top(miss))
    assert motion.duration < longest
    rates = np.diff(motion.path.joints, axis=0) / 0.01
    assert np.max(np.abs(rates)) <= np.deg2rad(220) * 1.001
    assert np.max(np.abs(np.diff(rates, axis=0))) / 0.01 <= 40.0 * 1.001
    # Off the pole the tool is as quick as without axes.
    q = motion.path.sample(0.01 * np.arange(motion.record_count)).q
    assert np.max(angle(q[1:], q[:-1])) / 0.01 > 1.2


def sky_pass(top_deg, seconds):
    """Return a straight pass overhead, as azimuth, elevation and time."""
    place = np.linspace(-4.0, 4.0, 121)
    height, aside = 1.0, 1.0 / np.tan(np.deg2rad(top_deg))
    azimuth = np.rad2deg(np.arctan2(aside, place))
    elevation = np.rad2deg(np.arctan2(height, np.hypot(place, aside)))
    times = np.linspace(0.0, seconds, len(place))
    rows = zip(azimuth.tolist(), elevation.tolist(), times.tolist(), strict=True)
    return {"approach": True, "keyframes": [
        {"azimuth_elevation": {"azimuth": a, "elevation": e}, "time": t} for a, e, t in rows
    ]}  # fmt: skip


def test_a_turntable_turns_as_often_as_its_axis_may():
    wide = [dict(AXES[0], limits_deg=[-7200, 7200]), *AXES[1:]]
    motion = planned({"rate": [0, 0, -1.2], "duration": 60}, axes=wide)
    joints = motion.path.joints[:, 0]
    assert joints[-1] < -72.0
    assert np.max(np.diff(joints)) < 1e-9
    held = slice(round(motion.start_time / 0.01) + 1, round(motion.end_time / 0.01))
    assert np.diff(joints)[held] == pytest.approx(-0.012, abs=1e-9)
    with pytest.raises(LimitError, match="angle of yaw"):
        planned({"rate": [0, 0, -1.2], "duration": 60})


LITTLE_ROLL = [*AXES[:2], dict(AXES[2], limits_deg=[-120, 120])]


@pytest.mark.parametrize(
    ("order", "top", "begun"),
    [("ZY", 30, 20.0), ("ZY", 60, 20.0), ("ZY", 85, 20.0), ("ZY", 89.5, 20.0),
     ("ZYX", 30, 20.0), ("ZYX", 60, 20.0), ("ZYX", 85, 120.0), ("ZYX", 89.5, 120.0),
     ("ZYX", 89.9, 600.0), pytest.param("ZY", 89.9, 20.0, marks=pytest.mark.slow)],
)  # fmt: skip
def test_pass_of_a_satellite_is_planned_or_says_how_long_would_do(order, top, begun):
    seconds, pattern = begun, r"([\d.]+) s in place of ([\d.]+) s would do"
    try:
        motion = planned(sky_pass(top, seconds), order, LITTLE_ROLL)
    except LimitError as error:
        seconds = float(re.search(pattern, str(error))[1])
        motion = planned(sky_pass(top, seconds), order, LITTLE_ROLL)
    assert motion.end_time - motion.start_time == pytest.approx(seconds, abs=0.02)
    points = rotate(motion.sample(motion.keyframe_times).q, np.array([1.0, 0.0, 0.0]))
    asked = rotate(motion.request.keys, np.array([1.0, 0.0, 0.0]))
    assert np.max(np.linalg.norm(points - asked, axis=1)) < 0.02
