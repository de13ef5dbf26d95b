"""What is asked for: keyframes with what else a motion is to keep, where it begins, and frames."""

from __future__ import annotations

from orientd.planner.request.columns import Turns, Vector3
from orientd.planner.request.frames import Frame, Pose, named_frames
from orientd.planner.request.request import (
    DEFAULT_METHOD,
    Keyframe,
    MotionRequest,
    Pace,
    Quaternion,
    State,
)
