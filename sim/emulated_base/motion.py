"""The motion of a base: roll, pitch and yaw as sums of sines, all from a seed."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

Quaternion = tuple[float, float, float, float]
Vector3 = tuple[float, float, float]

SINES = 5
"""Sines of each angle."""


@dataclass(frozen=True, slots=True)
class Base:
    """A kind of base.

    Attributes:
        low_hz: lowest frequency of its motion.
        high_hz: highest frequency.
        degrees: largest roll, pitch and yaw.
    """

    low_hz: float
    high_hz: float
    degrees: Vector3


BASES = {
    "ship": Base(0.05, 0.2, (10.0, 4.0, 3.0)),
    "vehicle": Base(0.3, 2.0, (2.0, 3.0, 4.0)),
    "rest": Base(0.1, 0.2, (0.0, 0.0, 0.0)),
}
"""Kinds of bases by name; the figures are typical, not of one ship or vehicle."""


class BaseMotion:
    """The orientation of a base at any time."""

    def __init__(self, name: str = "ship", seed: int = 0) -> None:
        """Create the motion of a kind of base.

        Raises:
            ValueError: there is no such kind.
        """
        if name not in BASES:
            raise ValueError(f"expected one of {', '.join(BASES)}, got {name!r}")
        kind, chance = BASES[name], random.Random(seed)
        self._angles = [
            _sines(math.radians(most), kind.low_hz, kind.high_hz, chance) for most in kind.degrees
        ]

    def orientation(self, t: float) -> Quaternion:
        """Return ``q_world_base`` at a time in s: yaw about z, pitch about y, roll about x."""
        roll, pitch, yaw = (sum(a * math.sin(w * t + p) for a, w, p in one) for one in self._angles)
        return _product(_product(_turn(3, yaw), _turn(2, pitch)), _turn(1, roll))

    def rate(self, t: float) -> Vector3:
        """Return the angular velocity in the frame of the base, rad/s."""
        roll, pitch, _ = (sum(a * math.sin(w * t + p) for a, w, p in one) for one in self._angles)
        u, v, r = (sum(a * w * math.cos(w * t + p) for a, w, p in one) for one in self._angles)
        sin, cos = math.sin(roll), math.cos(roll)
        level = math.cos(pitch) * r
        return (u - math.sin(pitch) * r, cos * v + sin * level, cos * level - sin * v)


def _sines(
    most: float, low_hz: float, high_hz: float, chance: random.Random
) -> list[tuple[float, float, float]]:
    """Return amplitude (rad), angular frequency (rad/s) and phase of each sine.

    The frequencies are spread evenly on a logarithmic scale.  Slow sines are larger, so that each
    of them has the same rate.
    """
    found = []
    for k in range(SINES):
        share = (k + chance.random()) / SINES
        w = 2.0 * math.pi * low_hz * (high_hz / low_hz) ** share
        found.append((1.0 / w, w, 2.0 * math.pi * chance.random()))
    total = sum(a for a, _, _ in found)
    return [(most * a / total, w, p) for a, w, p in found]


def _turn(axis: int, angle: float) -> Quaternion:
    q = [math.cos(0.5 * angle), 0.0, 0.0, 0.0]
    q[axis] = math.sin(0.5 * angle)
    return (q[0], q[1], q[2], q[3])


def _product(p: Quaternion, q: Quaternion) -> Quaternion:
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )
