"""The driver contract: what a device must do for the servo, and how it is found."""

from __future__ import annotations

from orientd.driver.contract import Driver
from orientd.driver.finding import Finding, Verdict
from orientd.driver.options import (
    check_names,
    choice,
    number,
    numbers,
    quaternion,
    switch,
    whole,
)
from orientd.driver.registry import driver_target, load_driver, make_driver
from orientd.driver.values import (
    IDENTITY,
    ZERO,
    AxisGap,
    AxisLimits,
    ComingPose,
    Feedback,
    Figure,
    Joints,
    PartHealth,
    Quaternion,
    Setpoint,
    ShapedPath,
    Vector3,
)

__all__ = [
    "IDENTITY",
    "ZERO",
    "AxisGap",
    "AxisLimits",
    "ComingPose",
    "Driver",
    "Feedback",
    "Figure",
    "Finding",
    "Joints",
    "PartHealth",
    "Quaternion",
    "Setpoint",
    "ShapedPath",
    "Vector3",
    "Verdict",
    "check_names",
    "choice",
    "driver_target",
    "load_driver",
    "make_driver",
    "number",
    "numbers",
    "quaternion",
    "switch",
    "whole",
]
