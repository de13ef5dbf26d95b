"""Timing of a path: times for keyframes, and the fastest profile within the limits."""

from __future__ import annotations

from orientd.planner.timing.axis_turn import (
    CAREFUL_JERK_SHARE,
    LEAST_SHARE,
    SHARE,
    phases_of_turn,
)
from orientd.planner.timing.even import evenly_made, evenly_paced
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import (
    SAME,
    Indices,
    Knots,
    chord_knots,
    chosen_knots,
    turn_lengths,
)
from orientd.planner.timing.profiles import (
    QuickPath,
    aimed_at,
    corners,
    lasting,
    quickest,
)
