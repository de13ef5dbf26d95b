"""Rotations as unit quaternions: algebra, exponential map, Jacobians and conversions.

Quaternions are ``(w, x, y, z)`` in the last axis, with Hamilton's product; everything broadcasts
over the leading axes and works in float64.  A quaternion and its negative are one orientation:
functions that return an orientation say which of the two they return.
"""

from orientd.rotation.convert import (
    Quaternion,
    from_axis_angle,
    from_euler,
    from_matrix,
    from_scipy,
    is_rotation,
    to_euler,
    to_matrix,
    to_scipy,
    unnamed,
)
from orientd.rotation.jacobian import right_jacobian, right_jacobian_inverse
from orientd.rotation.quaternion import (
    HALF_TURN,
    Floats,
    align,
    angle,
    are_half_turns,
    between,
    check_unit,
    conjugate,
    exp,
    exp_half,
    log,
    log_half,
    multiply,
    nearer_sign,
    normalize,
    power,
    rotate,
    slerp,
)
