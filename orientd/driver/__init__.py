"""The driver contract: what a device must do for the servo, and how it is found."""

from orientd.driver.contract import (
    IDENTITY,
    ZERO,
    Driver,
    Feedback,
    Figure,
    Quaternion,
    Setpoint,
    ShapedPath,
    Vector3,
)
from orientd.driver.finding import Finding, Verdict

__all__ = [
    "IDENTITY",
    "ZERO",
    "Driver",
    "Feedback",
    "Figure",
    "Finding",
    "Quaternion",
    "Setpoint",
    "ShapedPath",
    "Vector3",
    "Verdict",
]
