"""The tolerances that safety rests on, which planner, servo, drivers and daemon have in common."""

GUARD_TOLERANCE = 1.001
"""How far above a limit the servo's guard lets a setpoint be, as a factor: rounding and the
planner's grid, not a reserve."""

NORM_TOLERANCE = 1e-6
"""How far the norm of a quaternion may be from one; a larger error is not rounding."""

TYPED_NORM_TOLERANCE = 1e-3
"""The same of a keyframe, which people type with four digits: it is scaled to one, with a note."""

ROUNDING = 1e-15
"""How far from one the norm of a quaternion is that dividing by it would not bring nearer."""
