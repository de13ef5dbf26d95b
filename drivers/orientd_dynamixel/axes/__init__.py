"""What the axes of a running gimbal are told, and what is made of what they report."""

from __future__ import annotations

from orientd_dynamixel.axes.standing import Standing, complain, judge
from orientd_dynamixel.axes.turns import Turns
