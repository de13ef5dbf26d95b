"""Describe a serial chain of turning axes in numbers, as kernels take it.

The numbers come from the mechanism's own kinematics, so no driver has to state them twice.  They
are checked against it: a mechanism of another kind has no chain (``kernels/c/chain.h``).
"""

from __future__ import annotations

from array import array
from math import dist, pi

from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.floats import conjugate, cross, difference, exp, log, multiply, norm, plus, rotate
from orientd.mechanism.mechanism import Mechanism, Rows

MOST_AXES = 8
"""Most axes of a chain."""

_AGREEING = 1e-9
"""Largest difference from the mechanism's own kinematics, rad and m."""

Axis = tuple[Vector3, Vector3]
"""Unit direction of an axis, and a point on it, m, with all angles at zero."""


def chain_of(mechanism: Mechanism) -> array[float] | None:
    """Return the numbers of a mechanism's chain; ``None`` if it is not one of at most 8 axes."""
    count = len(mechanism.axes)
    if not 0 < count <= MOST_AXES:
        return None
    rest = mechanism.forward((0.0,) * count)
    axes = [_axis_of(mechanism, place, rest) for place in range(count)]
    for posture in range(2):
        joints = tuple(0.4 + 0.3 * place - 0.9 * posture for place in range(count))
        (q, position), own = _placed(axes, rest, joints), mechanism.forward(joints)
        if not max(norm(difference(q, own[0])), dist(position, own[1])) <= _AGREEING:
            return None
    return array("d", (*rest[0], *rest[1], *(x for axis in axes for v in axis for x in v)))


def axis_rows(mechanism: Mechanism, usable: float, margin: float = 0.0) -> Rows:
    """Return the limits of the axes as kernels take them.

    Args:
        mechanism: has the axes.
        usable: share of their velocity, acceleration and jerk.
        margin: angle that is kept to the ends of their ranges, rad.
    """
    found = Rows(len(mechanism.axes), 5)
    for place, one in enumerate(mechanism.axes):
        rates = (usable * rate for rate in (one.velocity, one.acceleration, one.jerk))
        found[place] = (one.low + margin, one.high - margin, *rates)
    return found


def _axis_of(mechanism: Mechanism, place: int, rest: tuple[Quaternion, Vector3]) -> Axis:
    """Return an axis by how a quarter turn about it moves the tool from *rest*."""
    joints = [0.0] * len(mechanism.axes)
    joints[place] = 0.5 * pi
    q, position = mechanism.forward(tuple(joints))
    turn = multiply(q, conjugate(rest[0]))
    direction = log(turn)
    direction = plus(ZERO, direction, 1.0 / norm(direction)) if norm(direction) else ZERO
    # For a quarter turn R about u through c, t = c - R c has 2 c = t + u x t across u.
    moved = plus(position, rotate(turn, rest[1]), -1.0)
    return direction, plus(plus(ZERO, moved, 0.5), cross(direction, moved), 0.5)


def _placed(
    axes: list[Axis], rest: tuple[Quaternion, Vector3], joints: Joints
) -> tuple[Quaternion, Vector3]:
    """Return the tool's pose: the product of the turns about the axes, and the pose at rest."""
    q, position = rest
    for (direction, point), angle in zip(reversed(axes), reversed(joints), strict=True):
        turn = exp(plus(ZERO, direction, angle))
        q = multiply(turn, q)
        position = plus(point, rotate(turn, plus(position, point, -1.0)), 1.0)
    return q, position
