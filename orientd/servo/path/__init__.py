"""Follow the path and stop on it: time scaling, stop rollout, feasible rates."""

from orientd.servo.path.path_follower import PathFollower, PathPart, StarvedError
from orientd.servo.path.path_point import PathPoint
from orientd.servo.path.quick_stop import QuickStop
from orientd.servo.path.time_scaling import TimeScaling
