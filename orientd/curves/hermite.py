"""What the Hermite families share: end conditions brought to the body frame, whole turns."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.keyframes import check_vector
from orientd.rotation import Floats, conjugate, rotate

FRAMES = ("body", "world")


def in_body_frame(vector: ArrayLike, name: str, q: Floats, frame: str) -> Floats:
    """Return a checked vector, given in the body or world frame, in the body frame at *q*.

    An angular acceleration changes frame as an angular velocity does, since the velocity's own
    cross product with itself is zero.

    Raises:
        ValueError: the vector is not three finite numbers.
    """
    checked = check_vector(vector, name)
    return rotate(conjugate(q), checked) if frame == "world" else checked


def with_revolutions(increment: Floats, revolutions: int) -> Floats:
    r"""Return a half-angle increment with whole turns added about its own axis.

    .. math:: w \, (1 + n \pi / \|w\|)

    Kim, Kim and Shin (1995), sec. 5.2.  An odd number ends at the negated quaternion, which is
    the same orientation.

    Raises:
        ValueError: turns are asked for and the increment, being zero, has no axis.
    """
    if revolutions == 0:
        return increment
    length = float(np.linalg.norm(increment))
    if length == 0.0:
        raise ValueError(
            "revolutions must be 0 when the middle increment of the curve is zero and so has no "
            f"axis, got {revolutions}"
        )
    return increment * (1.0 + revolutions * math.pi / length)
