"""The servo process: one device, one thread, one cycle after another."""

from orientd.servo.servo import Servo
from orientd.servo.watchdog import Watch

__all__ = ["Servo", "Watch"]
