"""Make whole turns to a single keyframe."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from orientd.errors import StartError
from orientd.planner.request import Keyframe, MotionRequest, State
from orientd.rotation import align, between, exp, log_half, multiply

_NO_AXIS = 1e-6
"""A turn this small has no axis to add whole turns about, rad."""
_MOST_AT_ONCE = math.pi / 3
"""From one keyframe to the next on the way of whole turns, rad."""


def wound(request: MotionRequest, start: State) -> MotionRequest:
    """Return *request* with keyframes on the way, where its only one has whole turns."""
    if not (request.is_single and request.turns[0]):
        return request
    if not start.is_at_rest:
        raise StartError("whole turns to a single keyframe begin at rest")
    (keyframe,) = request.keyframes
    shortest = 2.0 * log_half(between(*align([start.q, request.keys[0]])))
    size = float(np.linalg.norm(shortest))
    if size < _NO_AXIS:
        raise StartError("the device is there already: nothing says about which axis to turn")
    whole = shortest * (1.0 + 2.0 * math.pi * keyframe.turns / size)
    count = math.ceil(float(np.linalg.norm(whole)) / _MOST_AT_ONCE)
    passed = multiply(start.q, exp(whole * np.linspace(0.0, 1.0, count + 1)[:, None])).tolist()
    others = [Keyframe((w, x, y, z)) for w, x, y, z in passed[:-1]]
    return replace(request, keyframes=[*others, replace(keyframe, turns=0)], approach=False)
