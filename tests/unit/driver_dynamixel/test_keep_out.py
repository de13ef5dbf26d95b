"""Gimbals keep their pointing axis out of cones, by the angles that their servos are sent."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from orientd.config import DeviceSettings
from orientd.planner import Keyframe, MotionRequest, State
from orientd.rotation import from_euler, rotate

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
    assert "led around keep-out laser" in motion.certificate.notes
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
