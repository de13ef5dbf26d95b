"""Random motions of every kind, in the form of a motion file."""

from __future__ import annotations

import math
import random
from typing import Any

Quaternion = tuple[float, float, float, float]

MOST_KEYFRAMES = 10
PAIRS = ("slerp", "kks_hermite", "kks_quintic_hermite")
"""Methods for two keyframes; some motions have more."""


def wild_motion(
    chance: random.Random, methods: list[str], *, nearest: float = 1e-12
) -> tuple[list[Any], dict[str, Any]]:
    """Return the keyframes and options of a motion, with any of *methods*.

    A keyframe lies anywhere, or a step, half a turn or almost nothing from the one before.  Its
    sign is random.  Some motions are timed, and some run as quickly as the limits permit.

    Args:
        chance: of everything.
        methods: names of families of curves.
        nearest: how near duplicates may be, rad; to pass those 1e-12 rad apart, curves whose
            acceleration has steps may take half an hour.
    """
    method = chance.choice(methods)
    is_pair = method in PAIRS and chance.random() < 0.9
    keys = [anywhere(chance)]
    for _ in range(1 if is_pair else chance.randrange(MOST_KEYFRAMES)):
        keys.append(_next(chance, keys[-1], nearest))
    fields: dict[str, Any] = {"approach": True, "method": method}
    keyframes = [{"quaternion": dict(zip("wxyz", _signed(chance, q), strict=True))} for q in keys]
    kind = chance.choice(("own", "own", "minimum", "timed"))
    if kind == "minimum":
        fields["duration"] = "minimum"
    elif kind == "timed" and len(keys) > 1:
        step, is_even = chance.uniform(0.2, 4.0), chance.random() < 0.5
        fields["times"] = [
            step * (k if is_even else k + chance.uniform(0.0, 0.6)) for k in range(len(keys))
        ]
    if chance.random() < 0.15:
        for keyframe in keyframes:
            keyframe["position"] = [chance.uniform(-0.2, 0.2) for _ in range(3)]
    if chance.random() < 0.05:
        fields["end_velocity"] = [chance.uniform(-0.4, 0.4) for _ in range(3)]
    if chance.random() < 0.1:
        fields["limits"] = {"velocity": chance.uniform(0.3, 2.5)}
    return keyframes, fields


def anywhere(chance: random.Random) -> Quaternion:
    """Return an orientation, any as likely as any other."""
    w, x, y, z = (chance.gauss(0.0, 1.0) for _ in range(4))
    return _unit(w, x, y, z)


def turned(q: Quaternion, axis: tuple[float, ...], angle: float) -> Quaternion:
    """Return *q* turned about a body axis of unit length by *angle*, rad."""
    w, x, y, z = q
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    a, b, d = (s * part for part in axis)
    return _unit(
        w * c - x * a - y * b - z * d,
        w * a + x * c + y * d - z * b,
        w * b - x * d + y * c + z * a,
        w * d + x * b - y * a + z * c,
    )


def _next(chance: random.Random, q: Quaternion, nearest: float) -> Quaternion:
    _, *rest = anywhere(chance)
    length = math.sqrt(sum(part * part for part in rest))
    axis = tuple(part / length for part in rest)
    match chance.choice(("anywhere", "step", "step", "half turn", "duplicate")):
        case "anywhere":
            return anywhere(chance)
        case "step":
            return turned(q, axis, chance.uniform(0.02, 0.8))
        case "half turn":
            return turned(q, axis, math.pi)
        case _:
            return turned(q, axis, 10.0 ** chance.uniform(math.log10(nearest), -2.0))


def _signed(chance: random.Random, q: Quaternion) -> Quaternion:
    w, x, y, z = q
    return q if chance.random() < 0.5 else (-w, -x, -y, -z)


def _unit(w: float, x: float, y: float, z: float) -> Quaternion:
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return (w / norm, x / norm, y / norm, z / norm)
