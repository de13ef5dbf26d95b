"""The servo process: one device, one thread, one cycle after another."""

from orientd.servo.servo import Servo, Watch

__all__ = ["Servo", "Watch"]
