"""Choose the roll of keyframes that only say where to point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orientd.planner.request import MotionRequest, State
from orientd.rotation import Floats, multiply, rotate

_OPPOSITE = 1e-12
"""Square of the sine of the angle below which two directions have no common normal."""


def with_least_roll(request: MotionRequest, start: State) -> MotionRequest:
    """Return *request* with the orientations of its keyframes, where their roll is free.

    Each is the one that the least turn leads to from the one before: the roll is carried along, and
    nothing turns about the axis that points.
    """
    if not any(keyframe.free_roll for keyframe in request.keyframes):
        return request
    points = np.eye(3)["xyz".index(request.pointing_axis)]
    q, keyframes = start.q, []
    for keyframe, key in zip(request.keyframes, request.keys, strict=True):
        given = key
        if keyframe.free_roll:
            given = pointed(q, points, rotate(key, np.eye(3)[0]))
        q = given
        w, x, y, z = q.tolist()
        keyframes.append(replace(keyframe, q=(w, x, y, z), free_roll=False))
    return replace(request, keyframes=keyframes)


def pointed(q: Floats, axis: Floats, direction: Floats) -> Floats:
    """Return the orientation that the least turn leads to from *q*, with *axis* in a direction.

    Args:
        q: orientation, tool to world.
        axis: what is to point, a unit vector in tool coordinates.
        direction: where to, a unit vector in world coordinates.
    """
    turned = multiply(_least_turn(rotate(q, axis), direction), q)
    found: Floats = turned / np.linalg.norm(turned)
    return found


def _least_turn(a: Floats, b: Floats) -> Floats:
    """Return the least rotation that takes the unit vector *a* to *b*; half a turn has any axis."""
    if float(np.sum((a + b) ** 2)) < _OPPOSITE:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return np.concatenate([[0.0], axis / np.linalg.norm(axis)])
    half = (a + b) / np.linalg.norm(a + b)
    return np.concatenate([[float(a @ half)], np.cross(a, half)])
