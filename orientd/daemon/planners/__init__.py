"""Planner processes: warm, few, and each of them may be killed.

The daemon waits for many, a planner calculates: under one interpreter's lock each would spoil the
other.  A :class:`PlanInput` holds everything that a plan depends on, so whichever process does it,
and however often, the motion is the same to the last bit; no process keeps anything that matters.
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
        PlannerDevice,
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
            "PlannerDevice",
            "Rank",
            "record_at_rest",
        ),
    },
)
