"""The emulated arm: its models, kinematics and tool, and how it moves."""

from __future__ import annotations

from orientd_sim.ur.arm.arm import TICK, Arm, Mode
from orientd_sim.ur.arm.kinematics import TWISTS, speed
from orientd_sim.ur.arm.models import MODELS, Behaviour, version_of
from orientd_sim.ur.arm.tool import Tool, UnreachableError
from orientd_sim.ur.arm.transforms import from_pose, inverse, multiply, rotation_between, to_pose
