"""Follow the path and stop on it: time scaling, feasible rates, quick stop, cones ahead."""

from orientd.servo.path.path_follower import (
    KeepOutAhead,
    PathFollower,
    PathPart,
    StarvedError,
    joint_gap,
)
from orientd.servo.path.quick_stop import QuickStop
from orientd.servo.path.segment import PathPoint
from orientd.servo.path.time_scaling import TimeScaling
