"""Convert between poses and the rotation vectors of a UR controller.

A rotation vector has a seam: where the turn reaches pi, the shortest vector jumps to the opposite
side.  Both sides are the same orientation, so a controller that reads all six numbers of a pose at
once is not affected.  A controller that read half of them before and half after the jump would go
somewhere else.  So the vector continues beyond pi.  It changes sides only when it is longer than
1.5 pi, half-way to 2 pi, where its axis is undefined.  An orientation that oscillates about pi thus
never causes a jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, tau

from orientd.driver import Quaternion, Vector3
from orientd.floats import exp, log, norm

Pose = tuple[Quaternion, Vector3]
"""Orientation ``(w, x, y, z)`` and position, m."""

LONGEST = 1.5 * pi


def pose_of(numbers: Sequence[float]) -> Pose:
    """Return the controller's form of a pose as position, m, and rotation vector, rad."""
    x, y, z, rx, ry, rz = numbers
    return exp((rx, ry, rz)), (x, y, z)


def continued(q: Quaternion, last: Vector3) -> Vector3:
    """Return the rotation vector of *q* on the side of *last*, unless that is too long; rad."""
    r = log(q)
    rx, ry, rz = r
    angle = norm(r)
    if angle < tau - LONGEST:
        # The vector on the other side would exceed the allowed length.
        return r
    other = 1.0 - tau / angle
    ox, oy, oz = rx * other, ry * other, rz * other
    lx, ly, lz = last
    here = (rx - lx) ** 2 + (ry - ly) ** 2 + (rz - lz) ** 2
    there = (ox - lx) ** 2 + (oy - ly) ** 2 + (oz - lz) ** 2
    return (ox, oy, oz) if there < here else r
