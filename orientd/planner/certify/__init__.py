"""Check records against limits as a device differentiates them, and issue a certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.planner.certify.brake import (
        LONGEST_STOP,
        jerk_to_stop,
        longest_stop,
        longest_stop_from,
        share_to_stop,
        speed_to_stop,
    )
    from orientd.planner.certify.certificate import Certificate, Peak
    from orientd.planner.certify.joints import PARTS, joint_brake, tool_brake
    from orientd.planner.certify.measuring import (
        OFF_GRID,
        STATE,
        Peaks,
        limit_table,
        measure,
    )
    from orientd.planner.certify.summary import before, summed_up

__getattr__ = lazily(
    __name__,
    {
        "orientd.planner.certify.brake": (
            "LONGEST_STOP",
            "jerk_to_stop",
            "longest_stop",
            "longest_stop_from",
            "share_to_stop",
            "speed_to_stop",
        ),
        "orientd.planner.certify.certificate": ("Certificate", "Peak"),
        "orientd.planner.certify.joints": ("PARTS", "joint_brake", "tool_brake"),
        "orientd.planner.certify.measuring": (
            "OFF_GRID",
            "STATE",
            "Peaks",
            "limit_table",
            "measure",
        ),
        "orientd.planner.certify.summary": ("before", "summed_up"),
    },
)
