"""Gimbals on Dynamixel servos: bus, life cycle and options."""

from __future__ import annotations

from orientd_dynamixel.driver import DynamixelDriver
