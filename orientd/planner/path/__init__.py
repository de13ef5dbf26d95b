"""The geometry of a motion: a trajectory of orientations, and the position along it."""

from __future__ import annotations

from orientd.planner.path.path import Path, PathSamples, end_states
from orientd.planner.path.position import Motion3, PositionPath, position_path
from orientd.planner.path.recorded_path import SAME_ANGLE, RecordedPath
