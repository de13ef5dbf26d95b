"""The emulated arm: its models, kinematics and tool, and how it moves."""

from __future__ import annotations

from emulated_ur.arm.arm import TICK, Arm, Mode
from emulated_ur.arm.kinematics import TWISTS, speed
from emulated_ur.arm.models import MODELS, Behaviour, version_of
from emulated_ur.arm.tool import Tool, UnreachableError
from emulated_ur.arm.transforms import (
    from_pose,
    inverse,
    moved,
    multiply,
    rotated,
    rotation_between,
    to_pose,
)  # fmt: skip
