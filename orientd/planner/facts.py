"""The properties of a motion apart from its records, and the layout of a record, without arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import Any

from orientd.driver import Joints, Vector3
from orientd.model.limits import Limits
from orientd.stream.records import PATH_FLOATS

HISTORY = 3
"""Setpoints that a third difference reaches back to."""

MOTION_RECORD = Struct(f"@{PATH_FLOATS + 3}d")
"""A record of a motion: as the path ring has it, and the acceleration of the position."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionFacts:
    """The properties of a motion apart from its records.

    Attributes:
        id: its identifier.
        name: its label; empty if it has none.
        period: path time between two records, s.
        record_count: number of records; the last one is at rest.
        duration: path time from start to finish, s.
        start_time: path time of the first keyframe, s.
        end_time: path time of the last keyframe, s.
        last_passed: path time of the keyframe before the last, or of the end of a blend behind
            that; 0 if there is none.
        corner: for a motion blended with the previous one, the path time at which it is nearest to
            the end of that, s, and the distance, rad.
        limits: the limits that it keeps.
        brake_rate: share of full speed that it may lose per second, 1/s.
        stop_time: longest stop on its path from full speed, s.
        omega_start: requested angular velocity at the first keyframe, body frame, rad/s.
        omega_end: requested angular velocity at the last keyframe.
        device_options: of the device's driver.
        first_joints: initial axis angles, rad; empty unless planned for a device's axes.
        last_joints: final axis angles, rad.
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
    end_state: tuple[float, ...]
    corner: tuple[float, float] | None = None
