"""Hold records against limits as a device differentiates them, and say so in a certificate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.planner.certify.brake import (
        SLOWEST_STOP,
        jerk_to_stop,
        speed_to_stop,
    )
    from orientd.planner.certify.certificate import (
        Certificate,
        Peak,
    )
    from orientd.planner.certify.differences import (
        OFF_GRID,
        Rough,
    )
    from orientd.planner.certify.joints import (
        joint_brake,
    )
    from orientd.planner.certify.limit_tables import (
        limit_table,
    )
    from orientd.planner.certify.measuring import (
        CHUNK,
        measure,
        measure_path,
    )
    from orientd.planner.certify.peaks import (
        Peaks,
    )
    from orientd.planner.certify.summary import (
        before,
        summed_up,
    )

__getattr__ = lazily(
    __name__,
    {
        "orientd.planner.certify.brake": (
            "SLOWEST_STOP",
            "jerk_to_stop",
            "speed_to_stop",
        ),
        "orientd.planner.certify.certificate": (
            "Certificate",
            "Peak",
        ),
        "orientd.planner.certify.differences": (
            "OFF_GRID",
            "Rough",
        ),
        "orientd.planner.certify.joints": ("joint_brake",),
        "orientd.planner.certify.limit_tables": ("limit_table",),
        "orientd.planner.certify.measuring": (
            "CHUNK",
            "measure",
            "measure_path",
        ),
        "orientd.planner.certify.peaks": ("Peaks",),
        "orientd.planner.certify.summary": (
            "before",
            "summed_up",
        ),
    },
)
