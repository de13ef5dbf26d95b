"""Limits of devices that have published figures, by name, with where the figures are from.

A preset holds only what its source says; :data:`.DEFAULT_LIMITS` has the rest.  A maker's figures
bound what the device can do, not what is safe in front of people.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from orientd.model.limits import DEFAULT_LIMITS, Limits, Rate

_NO_LOAD_SHARE = 0.8  # of a servo's no-load speed; under load it is slower
_RPM = math.tau / 60.0


@dataclass(frozen=True, slots=True)
class Preset:
    """Limits with their source.

    Attributes:
        limits: complete; what the source leaves open is the default.
        source: of the figures.
    """

    limits: Limits
    source: str


def _preset(source: str, **rates: Rate) -> Preset:
    return Preset(DEFAULT_LIMITS.with_rates(rates), source)


PRESETS = {
    "franka-fr3": _preset(
        "Franka Control Interface, control parameters: Cartesian limits of the Franka Research 3",
        velocity=2.5,
        acceleration=17.0,
        jerk=8500.0,
        linear_velocity=3.0,
        linear_acceleration=9.0,
    ),
    "franka-panda": _preset(
        "Franka Control Interface, control parameters: Cartesian rotation limits of the Panda",
        velocity=2.5,
        acceleration=25.0,
        jerk=12500.0,
    ),
    "ur5e": _preset(
        "Universal_Robots_ROS2_Description, joint_limits.yaml: every joint turns at most "
        "180 deg/s; no angular speed of the tool and no acceleration is published",
        velocity=math.radians(180.0),
    ),
    "ur10e": _preset(
        "Universal_Robots_ROS2_Description, joint_limits.yaml: the slowest joint turns at most "
        "120 deg/s; no angular speed of the tool and no acceleration is published",
        velocity=math.radians(120.0),
    ),
    "pan-tilt-xm430-w350": _preset(
        "ROBOTIS e-Manual, XM430-W350: 46 rpm without load at 12 V, of which 80 % are used; "
        "no acceleration is published",
        velocity=_NO_LOAD_SHARE * 46.0 * _RPM,
    ),
    "pan-tilt-xl330-m288": _preset(
        "ROBOTIS e-Manual, XL330-M288: 103 rpm without load at 5 V, of which 80 % are used; "
        "no acceleration is published",
        velocity=_NO_LOAD_SHARE * 103.0 * _RPM,
    ),
}
"""By the name that ``preset`` has in a device's limits."""
