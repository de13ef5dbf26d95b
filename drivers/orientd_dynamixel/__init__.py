"""Gimbals on Dynamixel servos: the driver, and the planning of axis angles along a whole path.

The driver runs in the servo process and uses no NumPy; :mod:`orientd_dynamixel.kinematics` and
:mod:`orientd_dynamixel.path` do, and are imported by name.
"""

from __future__ import annotations

from orientd_dynamixel.driver import DynamixelDriver
