"""Hold records against limits as a device differentiates them, and say so in a certificate."""

from __future__ import annotations

from orientd.planner.certify.brake import SLOWEST_STOP, jerk_to_stop, speed_to_stop
from orientd.planner.certify.certificate import Certificate, Peak
from orientd.planner.certify.differences import OFF_GRID, Rough
from orientd.planner.certify.joints import joint_brake
from orientd.planner.certify.limit_tables import limit_table
from orientd.planner.certify.measuring import CHUNK, measure, measure_path
from orientd.planner.certify.peaks import Peaks
from orientd.planner.certify.summary import before, summed_up
