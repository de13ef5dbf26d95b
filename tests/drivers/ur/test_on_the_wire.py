"""The certified setpoints arrive at a controller, as its emulator has recorded them."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from arm_recording import read_setpoints
from direct_planners import run
from judge import Judge
from ur_rig import device_of, is_holding, plan, until

from orientd import rotation
from orientd.driver import AxisLimits
from orientd.errors import Fault
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.recorded import rows_of

pytest.importorskip("rtde_control")

MODELS = json.loads((Path(__file__).parents[2] / "data/ur/models.json").read_text())
TWISTS = np.array([0.5, 0.0, 0.0, 0.5, -0.5, 0.0]) * math.pi


def flange(name, joints):
    """Return rotation and position by the published table, one transform after the other."""
    d1, a2, a3, d4, d5, d6, _ = MODELS[name]
    found = np.eye(4)
    for a, d, twist, turn in zip(
        (0, a2, a3, 0, 0, 0), (d1, 0, 0, d4, d5, d6), TWISTS, joints, strict=True
    ):
        c, s, ca, sa = math.cos(turn), math.sin(turn), math.cos(twist), math.sin(twist)
        found = found @ [
            [c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]
        ]  # fmt: skip
    return found[:3, :3], found[:3, 3]


def matrix_of(vector):
    """Return the matrix of a rotation vector, by Rodrigues' formula."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def test_joints_that_were_certified_make_the_poses_that_arrive(ur_robot, tmp_path):
    ur_robot.ask("record on")
    options = {"model": "ur5e", "joint_acceleration_deg": 400.0, "keep_phase": False}
    with device_of(ur_robot.host, **options) as device:
        stood = ur_robot.state()["target_q"]
        start = device.commanded()
        away = rotation.multiply(start.q, rotation.exp([0.2, -0.3, 0.25]))
        there = tuple(np.add(start.position, (0.05, -0.03, 0.04)).tolist())
        begin = Keyframe(start.q, position=tuple(start.position))
        keyframes = [begin, Keyframe(tuple(away.tolist()), position=there)]
        motion = plan(device, MotionRequest(keyframes))
        run(device, motion)
        until(lambda: device.snapshot().path_time > 0.1, "the motion")
        until(lambda: is_holding(device), "the end", motion.facts.duration + 10.0)
        assert device.snapshot().fault is Fault.NONE
    ur_robot.ask(f"record write {tmp_path / 'run'}")
    arrived = np.array([row.target for row in read_setpoints(tmp_path / "run")])
    planned = rows_of(motion.read(0, motion.facts.record_count))
    joints = planned[:, -12:-6]  # then their velocities
    assert joints[0] == pytest.approx(stood, abs=1e-9)
    # The device holds before and after: the motion is where the first record is left.
    first = int(np.argmax(np.linalg.norm(arrived - arrived[0], axis=1) > 0.0))
    begun = int(np.argmax(np.linalg.norm(planned[:, 10:13] - planned[0, 10:13], axis=1) > 0.0))
    arrived = arrived[first - begun :][: len(planned)]
    assert len(arrived) == len(planned)
    for row, angles in zip(arrived, joints, strict=True):
        turned, position = flange("ur5e", angles)
        assert np.max(np.abs(row[:3] - position)) < 1e-9
        assert np.max(np.abs(matrix_of(row[3:]) - turned)) < 1e-9
    violations = []
    judge = Judge({}, 0.002, violations.append)
    judge.axes = [
        AxisLimits(name, -math.inf, math.inf, math.pi, math.radians(400.0)) for name in "123456"
    ]
    for k, angles in enumerate(joints.tolist(), 1):
        judge.take(2_000_000 * k, (1.0, 0.0, 0.0, 0.0), joints=tuple(angles))
    assert not violations
