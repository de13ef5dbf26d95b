"""What the Hermite families share: end conditions in the body frame, whole turns, their choice."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct.acceleration_integral import squared_acceleration
from orientd.curves.construct.basis import CumulativeBasis
from orientd.curves.construct.cumulative import CumulativeCurve
from orientd.curves.keyframes import (
    ParameterError,
    check_bool,
    check_integer,
    check_quaternion,
    check_vector,
)
from orientd.rotation import Floats, conjugate, rotate
from orientd.rotation import align as align_signs

FRAMES = ("body", "world")
LEAST = "least"


def check_ends(q0: ArrayLike, q1: ArrayLike, *, align: object) -> tuple[Floats, Floats]:
    """Return the first and the last orientation; with *align* the last near to the first in sign.

    Raises:
        ValueError: one of them is no unit quaternion, or *align* no bool.
    """
    ends = np.stack([check_quaternion(q0, "q0"), check_quaternion(q1, "q1")])
    start, end = align_signs(ends) if check_bool(align, "align") else ends
    return start, end


def in_body_frame(vector: ArrayLike, name: str, q: Floats, frame: str) -> Floats:
    """Return a checked vector, given in the body or world frame, in the body frame at *q*.

    An angular acceleration changes frame as an angular velocity does, since the velocity's own
    cross product with itself is zero.

    Raises:
        ValueError: the vector is not three finite numbers.
    """
    checked = check_vector(vector, name)
    return rotate(conjugate(q), checked) if frame == "world" else checked


def turned(
    increments: Floats, revolutions: object, basis: CumulativeBasis, start: Floats
) -> Floats:
    r"""Return increments whose middle one has whole turns added about its own axis.

    .. math:: w \, (1 + n \pi / \|w\|)

    Kim, Kim and Shin (1995), sec. 5.2.  An odd number ends at the negated quaternion, which is
    the same orientation.

    The best number is that of least effort, the integral of the squared angular acceleration; every
    one is tried that the outer increments could drive, up to :math:`\sum \|w_i\| / \pi + 2` either
    way.  No formula will do: rounding the middle increment to half of what the ends bring finds the
    best number in five cases of six at 5 rad/s over a second, and in one of ten at 50.

    Args:
        increments: half-angle vectors without whole turns, an odd number, shape ``(m, 3)``.
        revolutions: how many turns; ``"least"`` looks for the best number.
        basis: of the curve.
        start: its first orientation.

    Raises:
        ValueError: *revolutions* is neither, or turns are asked for and the middle increment, being
            zero, has no axis.
    """
    middle = len(increments) // 2
    length = float(np.linalg.norm(increments[middle]))

    def with_turns(count: int) -> Floats:
        changed = increments.copy()
        changed[middle] *= 1.0 + count * math.pi / length
        return changed

    if not isinstance(revolutions, str):
        given = check_integer(revolutions, "revolutions")
        if given and length == 0.0:
            raise ParameterError(
                "revolutions",
                "revolutions must be 0 when the middle increment of the curve is zero and so has "
                f"no axis, got {given}",
            )
        return with_turns(given) if given else increments
    if revolutions != LEAST:
        raise ParameterError(
            "revolutions", f"revolutions must be a whole number or {LEAST!r}, got {revolutions!r}"
        )
    if length == 0.0:
        return increments
    outer = np.delete(increments, middle, axis=0)
    most = math.ceil(float(np.sum(np.linalg.norm(outer, axis=-1))) / math.pi) + 2
    found, least = increments, math.inf
    # From few turns to many: of equals, the fewest.
    for count in sorted(range(-most, most + 1), key=abs):
        changed = with_turns(count)
        curve = CumulativeCurve(basis=basis, controls=start[None], increments=changed, continuity=2)
        effort = squared_acceleration(curve.evaluate, np.linspace(*curve.domain, 5 + 2 * most))
        if effort < least * (1.0 - 1e-9):
            found, least = changed, effort
    return found
