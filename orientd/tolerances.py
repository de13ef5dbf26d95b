"""Safety-relevant tolerances that planner, servo, drivers and daemon share."""

GUARD_TOLERANCE = 1.001
"""Factor by which a setpoint may exceed a limit at the servo's guard.

It allows for rounding and for the planner's grid; it is not a reserve.
"""

NORM_TOLERANCE = 1e-6
"""Tolerance of a quaternion's norm; a larger error is not rounding."""

TYPED_NORM_TOLERANCE = 1e-3
"""Tolerance of a keyframe's norm, which users type with four digits; it is scaled, with a note."""

ROUNDING = 1e-15
"""Error of a quaternion's norm below which dividing by it would not help."""
