"""How quickly to run along a path: times for keyframes, the fastest profile inside the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.planner.timing.candidate_path import KeyframePath, PathRequest
    from orientd.planner.timing.quickest_timing import SHARE, quickest
    from orientd.planner.timing.survey import Survey
    from orientd.planner.timing.timing import (
        LONGER,
        SAME,
        Indices,
        chord_knots,
        move_lengths,
        radians_per_metre,
        shortest,
        turn_lengths,
    )

__getattr__ = lazily(__name__)
