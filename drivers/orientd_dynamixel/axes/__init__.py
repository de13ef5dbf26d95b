"""What the axes of a running gimbal are told, and what is made of what they report."""

from __future__ import annotations

from orientd_dynamixel.axes.standing import Standing
from orientd_dynamixel.axes.supervisor import Supervisor
from orientd_dynamixel.axes.turns import Turns
from orientd_dynamixel.axes.ways import way

__all__ = ["Standing", "Supervisor", "Turns", "way"]
