"""What there is to know of a motion besides its records, and what a record is, without arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Any

from orientd.driver import Joints, Vector3
from orientd.model import Limits
from orientd.stream import PATH_FLOATS

HISTORY = 3
"""Setpoints that a third difference reaches back to."""

MOTION_RECORD = Struct(f"@{PATH_FLOATS + 3}d")
"""A record of a motion: as the path ring has it, and the acceleration of the position."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionFacts:
    """What there is to know of a motion besides its records.

    Attributes:
        id: identifies it.
        name: what people call it; empty where they do not.
        period: path time from one record to the next, s.
        record_count: number of records; the last one is at rest.
        duration: path time from hold to hold, s.
        start_time: path time of the first keyframe, s.
        end_time: path time of the last keyframe, s.
        last_passed: path time of the last keyframe before that one; 0 where there is none.
        corner: of a motion that is blended with the one before, the path time at which it is
            nearest to the end of that, s, and how near, rad.
        limits: what it keeps.
        brake_rate: share of full speed by which it may be slowed down in a second, 1/s.
        stop_time: how long a stop on its path from full speed takes at the most, s.
        omega_start: angular velocity asked for at the first keyframe, body frame, rad/s.
        omega_end: the same at the last keyframe.
        device_options: of the device's driver.
        first_joints: axis angles it begins at, rad; empty unless it was made for a device's axes.
        last_joints: axis angles it ends at, rad.
    """

    id: str
    name: str
    period: float
    record_count: int
    duration: float
    start_time: float
    end_time: float
    last_passed: float
    limits: Limits
    brake_rate: float
    stop_time: float
    omega_start: Vector3 | None
    omega_end: Vector3 | None
    device_options: Mapping[str, Any]
    first_joints: Joints
    last_joints: Joints
    corner: tuple[float, float] | None = None
