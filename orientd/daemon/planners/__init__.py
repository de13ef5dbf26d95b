"""Planner processes: warm, few, and each of them may be killed.

The daemon mostly waits and a planner calculates, so under one interpreter's lock each would delay
the other.  A :class:`PlanInput` holds everything that a plan depends on.  Any process that plans it
again gets the same motion to the last bit.  No process keeps state that a plan needs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.planners.planned_motion import PlannedMotion
    from orientd.daemon.planners.pool import Planners, default_processes
    from orientd.daemon.planners.task import (
        PlanCall,
        PlanInput,
        Rank,
        record_at_rest,
    )

__getattr__ = lazily(
    __name__,
    {
        "orientd.daemon.planners.planned_motion": ("PlannedMotion",),
        "orientd.daemon.planners.pool": ("Planners", "default_processes"),
        "orientd.daemon.planners.task": (
            "PlanCall",
            "PlanInput",
            "Rank",
            "record_at_rest",
        ),
    },
)
