"""How quickly to run along a path: times for keyframes, the fastest profile inside the limits."""

from __future__ import annotations

from orientd.planner.timing.axis_turn import (
    CAREFUL_JERK_SHARE,
    LEAST_SHARE,
    LONGEST_STOP,
    SHARE,
    longest_stop,
    phases_of_turn,
)
from orientd.planner.timing.by_parts import (
    corners,
    least_with_stops,
    quickest_by_parts,
)
from orientd.planner.timing.candidate_path import KeyframePath, PathRequest
from orientd.planner.timing.even_timing import evenly_paced
from orientd.planner.timing.knot_times import with_chosen_times
from orientd.planner.timing.quickest_timing import (
    FirstProfile,
    Profile,
    QuickPath,
    aimed_at,
    lasting,
    quickest,
)
from orientd.planner.timing.timing import (
    SAME,
    Indices,
    Knots,
    chord_knots,
    turn_lengths,
)
