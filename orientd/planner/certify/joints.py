r"""What a path asks of the device's joints, and how fast it may be slowed down for their sake.

The joints are known at the records, a period apart, and are differentiated as the device does it.
After a pause, a stop or another speed the setpoints lie between the records, where the servo draws
a cubic; the second differences of setpoints halfway between the records are weighted means of those
on the records, and count, too.

A joint's acceleration at the rate :math:`\sigma` is :math:`\theta''\sigma^2 + \theta'\dot\sigma`,
the inequality of :mod:`orientd.planner.certify.brake` in one dimension.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, brake_rate
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

_HALFWAY = np.array([1.0, -9.0, 56.0, 56.0, -9.0, 1.0]) / 96.0
"""Weights of the records around the place halfway between two, of the cubic with slopes by central
differences of the fourth order."""


_LOCAL = 0.95
"""Share of the limit up to which the acceleration at a record counts, as in ``brake.c``."""


class JointBrake(NamedTuple):
    """How fast a path may be slowed down for the joints' sake.

    Attributes:
        rate: largest safe brake rate, 1/s.
        record: that sets it.
    """

    rate: float
    record: int


def joint_brake(
    joints: Floats, earlier: Floats, period: float, limits: Sequence[tuple[float, float]]
) -> JointBrake:
    """Return how fast a path may be slowed down for the joints' sake.

    Args:
        joints: at the records of the path, rad, shape ``(n, joints)``; the device stays at the
            last.
        earlier: at the records before it, two or more, the oldest first, rad, shape
            ``(m, joints)``.
        period: from one record to the next, s.
        limits: largest velocity and acceleration of every joint, rad/s and rad/s^2.
    """
    held = np.repeat(joints[-1:], len(_HALFWAY) // 2, axis=0)
    # What ends before the first record is the past, which nothing can change.
    rows = np.concatenate([earlier[-2:], joints, held])
    steps = np.diff(rows, axis=0) / period
    bends = np.diff(steps, axis=0) / period
    between = sum(
        weight * bends[k : len(bends) - len(_HALFWAY) + 1 + k] for k, weight in enumerate(_HALFWAY)
    )
    # Of each bend: the faster of the two steps that it is between, and the sharper of its
    # neighbours halfway.
    speed = np.maximum(np.abs(steps[:-1]), np.abs(steps[1:]))
    bend = np.abs(bends)
    reach = slice(2, 2 + len(between))
    bend[reach] = np.maximum(bend[reach], np.abs(between))
    _, hardest = GUARD_TOLERANCE * np.array(limits, dtype=np.float64).T
    # At the records themselves, by central differences of the fourth order: at full speed they do
    # not count, so that a share of the limit is left.
    local = np.abs(14.0 * bends[1:-1] - bends[:-2] - bends[2:]) / 12.0
    bend[1:-1] = np.maximum(bend[1:-1], np.minimum(local, _LOCAL * hardest))
    rate, record = FASTEST_BRAKE_RATE, 0
    still = np.zeros(len(bend))
    for joint, most in enumerate(hardest.tolist()):
        place = slice(joint, joint + 1)
        one = brake_rate(speed[:, place], bend[:, place], still, most, np.inf)
        if one[0] < rate:
            rate, record = one
    return JointBrake(rate, record)
