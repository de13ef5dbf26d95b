"""The geometry of a motion: curves laid end to end in time, with the position that goes along."""

from __future__ import annotations

from orientd.planner.path.path import Path, PathSamples, PathSegment
from orientd.planner.path.path_curve import PathCurve
from orientd.planner.path.plain_path import plain_curve
from orientd.planner.path.position import (
    DEGREE,
    UNIT_ACCELERATION,
    UNIT_JERK,
    UNIT_VELOCITY,
    Motion3,
    PositionPath,
    position_path,
    quintic,
)
from orientd.planner.path.retimed_position import repositioned
from orientd.planner.path.row_path import RowPath
from orientd.planner.path.table_path import SAME_ANGLE, TablePath
