"""Mechanisms: the kinematics of a device's axes, and paths that keep the limits of the axes.

The servo uses plain floats and kernels.  The modules that plan whole paths need NumPy and load on
first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.mechanism.arrays import orientations
    from orientd.mechanism.figure import Figure, Loss
    from orientd.mechanism.following import USABLE, Following
    from orientd.mechanism.foresight import AxisStop, ComingStop, Foresight, refusal
    from orientd.mechanism.gimbal import Gimbal
    from orientd.mechanism.gimbal_route import pointing_error
    from orientd.mechanism.joint_path import JointPath, ToolLimits
    from orientd.mechanism.keep_out_slews import Clearance
    from orientd.mechanism.mechanism import Mechanical, Mechanism, Reserve, Rows
    from orientd.mechanism.pacing import pace
    from orientd.mechanism.routing import joints_along, route, route_at_times
    from orientd.mechanism.turning import pointed, together, windings

__getattr__ = lazily(
    "orientd.mechanism",
    {
        "orientd.mechanism.arrays": ("orientations",),
        "orientd.mechanism.following": ("USABLE", "Following"),
        "orientd.mechanism.figure": ("Figure", "Loss"),
        "orientd.mechanism.foresight": ("AxisStop", "ComingStop", "Foresight", "refusal"),
        "orientd.mechanism.gimbal": ("Gimbal",),
        "orientd.mechanism.gimbal_route": ("pointing_error",),
        "orientd.mechanism.joint_path": ("JointPath", "ToolLimits"),
        "orientd.mechanism.keep_out_slews": ("Clearance",),
        "orientd.mechanism.mechanism": ("Mechanical", "Mechanism", "Reserve", "Rows"),
        "orientd.mechanism.pacing": ("pace",),
        "orientd.mechanism.routing": ("joints_along", "route", "route_at_times"),
        "orientd.mechanism.turning": ("pointed", "together", "windings"),
    },
)
