"""The driver contract: what a device must do for the servo, and how it is found."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
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
        ComingPose,
        Feedback,
        Figure,
        PartHealth,
        Quaternion,
        Setpoint,
        ShapedPath,
        Vector3,
    )

__getattr__ = lazily(__name__)
