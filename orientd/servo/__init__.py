"""The servo process: one device, one thread, one cycle after another."""

from __future__ import annotations

from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.path.path_follower import FINAL_WORD, TAIL_WORD
from orientd.servo.path.segment import Segment, point_of
from orientd.servo.path.time_scaling import records_to_stop
from orientd.servo.process import ProcessSettings
from orientd.servo.realtime import set_scheduling
from orientd.servo.servo import Servo
from orientd.servo.tracking.chunks import ChunkReport, publish_chunk, read_report
from orientd.servo.tracking.target_follower import HELD_WORD, LEFT_OUT_WORD
from orientd.servo.watchdog import WatchdogTimeouts
