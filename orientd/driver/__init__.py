"""The driver contract: what a device must do for the servo, and how it is found."""

from orientd.driver.contract import (
    IDENTITY,
    ZERO,
    Driver,
    Feedback,
    Figure,
    Finding,
    Quaternion,
    Setpoint,
    ShapedPath,
    Vector3,
)

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
]
