"""Gimbals on Dynamixel servos."""
