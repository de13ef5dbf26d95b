"""The driver contract: what a device must do for the servo, and how it is found."""

from __future__ import annotations

from orientd.driver.contract import Driver
from orientd.driver.diagnosing import findings_of, needs
from orientd.driver.finding import Finding, Verdict
from orientd.driver.follow_check import FollowCheck
from orientd.driver.foreign_python import python_command, python_version
from orientd.driver.options import (
    check_names,
    choice,
    number,
    numbers,
    quaternion,
    switch,
    whole,
)
from orientd.driver.protocols import (
    Arriving,
    Diagnosable,
    Explaining,
    Freeable,
    Healthy,
    Locatable,
    Parkable,
    PhaseLocked,
    Resettable,
    RestsInFault,
    Scaled,
    Tunable,
    tune,
)
from orientd.driver.registry import driver_target, load_driver, make_driver
from orientd.driver.values import (
    FUTURE_NS,
    IDENTITY,
    MOST_JOINTS,
    ZERO,
    AxisGap,
    AxisLimits,
    Feedback,
    Joints,
    PartHealth,
    Quaternion,
    Setpoint,
    Vector3,
    feedback_problem,
)

__all__ = [
    "FUTURE_NS",
    "IDENTITY",
    "MOST_JOINTS",
    "ZERO",
    "Arriving",
    "AxisGap",
    "AxisLimits",
    "Diagnosable",
    "Driver",
    "Explaining",
    "Feedback",
    "Finding",
    "FollowCheck",
    "Freeable",
    "Healthy",
    "Joints",
    "Locatable",
    "Parkable",
    "PartHealth",
    "PhaseLocked",
    "Quaternion",
    "Resettable",
    "RestsInFault",
    "Scaled",
    "Setpoint",
    "Tunable",
    "Vector3",
    "Verdict",
    "check_names",
    "choice",
    "driver_target",
    "feedback_problem",
    "findings_of",
    "load_driver",
    "make_driver",
    "needs",
    "number",
    "numbers",
    "python_command",
    "python_version",
    "quaternion",
    "switch",
    "tune",
    "whole",
]
