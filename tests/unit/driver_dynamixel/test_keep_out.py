"""Gimbals keep their pointing axis out of cones, by the angles that their servos are sent."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from orientd.config import DeviceSettings
from orientd.errors import PlanError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.state import State
from orientd.rotation import from_euler, rotate
from orientd_rotctld import satellite_pass

CONFIG = Path(__file__).parents[3] / "config" / "gimbal.toml"
CONE = {
    "name": "laser",
    "azimuth_elevation": {"azimuth": 40, "elevation": 5},
    "half_angle_deg": 12,
}
DIRECTION = np.array(Keyframe(azimuth_elevation={"azimuth": 40.0, "elevation": 5.0}).q)
START = State.at_rest((1.0, 0.0, 0.0, 0.0))


def planner(axes):
    settings = tomllib.loads(CONFIG.read_text(encoding="utf-8"))["devices"]["gimbal"]
    options = settings["options"]
    changes = {"order": "ZYX"[:axes], "axes": options["axes"][:axes]}
    options = {**options, **changes}
    return DeviceSettings(
        name="gimbal", **{**settings, "options": options, "keep_out": [CONE]}
    ).planner()


def toward(azimuth, elevation, **others):
    return Keyframe(azimuth_elevation={"azimuth": azimuth, "elevation": elevation}, **others)


def clearance(motion, axes):
    """Return the least clearance by the angles of the axes alone, degrees."""
    rows = motion.rows(0, motion.record_count)
    joints = rows[:, -2 * axes : -axes]
    q = np.array([from_euler("ZYX"[:axes], row) for row in joints])
    cosine = rotate(q, [1.0, 0.0, 0.0]) @ rotate(DIRECTION, [1.0, 0.0, 0.0])
    return math.degrees(np.min(np.arccos(np.clip(cosine, -1.0, 1.0)))) - 12.0


@pytest.mark.parametrize("axes", [2, 3])
def test_the_axes_of_a_gimbal_lead_around_a_cone(axes):
    request = MotionRequest([toward(80.0, 0.0), toward(10.0, 40.0)], approach=True)
    motion = planner(axes).plan(request, start=START, joints=(0.0,) * axes, is_offline=True)
    assert clearance(motion, axes) >= 0.0
    assert "led around keep-out laser to its first keyframe" in motion.certificate.notes
    points = rotate(motion.sample(motion.keyframe_times).q, [1.0, 0.0, 0.0])
    asked = rotate(np.array([one.q for one in request.keyframes]), [1.0, 0.0, 0.0])
    assert np.allclose(points, asked, atol=0.01)  # it passes one between two cycles


@pytest.mark.parametrize("axes", [2, 3])
def test_a_gimbal_is_led_around_to_the_beginning_of_a_timed_pass(axes):
    keyframes = [toward(75.0 + 5.0 * t, 10.0 * t, time=t) for t in (0.0, 1.0, 2.0)]
    request = MotionRequest(keyframes, approach=True)
    motion = planner(axes).plan(request, start=START, joints=(0.0,) * axes, is_offline=True)
    assert clearance(motion, axes) >= 0.0
    assert np.diff(motion.keyframe_times) == pytest.approx([1.0, 1.0])


def rotator(half_angle_deg):
    """A rotator from north to north at 30 deg/s, with a cone in the south; ``None`` for none."""
    axes = [
        {"id": 1, "name": "azimuth", "limits_deg": [0, 360], "velocity_deg": 30,
         "acceleration_deg": 60},
        {"id": 2, "name": "elevation", "limits_deg": [0, 90], "velocity_deg": 30,
         "acceleration_deg": 60},
    ]  # fmt: skip
    options = {"port": "virtual", "order": "ZY", "mount": {"w": 0, "x": 1, "y": 0, "z": 0},
               "allow_slews": True, "turns_file": "", "axes": axes}  # fmt: skip
    south = {"azimuth": 180, "elevation": 30}
    cone = {"name": "sun", "azimuth_elevation": south, "half_angle_deg": half_angle_deg}
    limits = {"velocity": 1.5, "acceleration": 8.0, "jerk": 1500.0}
    return DeviceSettings(
        name="rotator", driver="dynamixel", rate_hz=50, limits=limits, options=options,
        keep_out=[cone] if half_angle_deg else [],
    ).planner()  # fmt: skip


def planned_pass(half_angle_deg):
    """Plan a pass of a minute past north, which needs a whole turn of the azimuth."""
    times = np.arange(61.0)
    request = satellite_pass(times, 300.0 + 2.0 * times, np.full(61, 30.0))
    start = State.at_rest((0.0, 1.0, 0.0, 0.0))
    return rotator(half_angle_deg).plan(request, start=start, joints=(0.0, 0.0), is_offline=True)


def test_a_pass_slews_around_a_cone_and_tells_what_it_loses():
    free, motion = planned_pass(0), planned_pass(12)
    lost = [sum(one.end - one.start for one in m.certificate.losses) for m in (free, motion)]
    print(f"lost {lost[0]:.2f} s, around the cone {lost[1]:.2f} s")
    assert lost[0] > 0.0
    assert lost[1] <= 1.05 * lost[0] + 0.5
    (sun,) = (one for one in motion.certificate.figures if one.name == "keep-out sun")
    assert sun.value >= 0.0
    assert "the axes slew around keep-out cones" in motion.certificate.notes
    points = rotate(motion.rows(0, motion.record_count)[:, :4], [1.0, 0.0, 0.0])
    cosine = points @ np.array([-math.cos(math.radians(30.0)), 0.0, 0.5])
    assert math.degrees(math.acos(min(float(cosine.max()), 1.0))) >= 12.0


def test_a_pass_whose_slews_have_no_way_around_is_refused():
    with pytest.raises(PlanError, match="the axes would slew through keep-out sun"):
        planned_pass(85)
