"""What the axes of a running gimbal are told."""

from __future__ import annotations

from orientd_dynamixel.axes.following import Following
from orientd_dynamixel.axes.supervisor import SLACK, TICK, complain_of_step
