"""Notes on half turns: which of the two ways was taken, and how to choose the other."""

from __future__ import annotations

import numpy as np

from orientd.planner.request import MotionRequest, State
from orientd.rotation import Floats, align, are_half_turns, between

_MOST = 3
"""Half turns that have a note each; the others are counted."""


def half_turn_notes(request: MotionRequest, start: State, *, has_turns: bool) -> list[str]:
    """Return what the certificate says of half turns that give no turns of their own.

    Args:
        request: in device coordinates.
        start: where the device is commanded to be.
        has_turns: whether the method can make whole turns.
    """
    keys, turns, first = request.keys, request.turns, 0
    if request.approach and start.is_at_rest and request.omega_start is None:
        keys, turns, first = np.vstack([start.q, keys]), np.append(0, turns), -1
    is_half = are_half_turns(keys)
    if not is_half.any():
        return []
    places, notes = np.flatnonzero(is_half & (turns[1:] == 0)).tolist(), []
    for place in places[:_MOST]:
        pair, index = keys[place : place + 2], place + 1 + first
        is_approach = index == 0 and not request.is_single
        way = "`turns: -1` there" if has_turns and not is_approach else "a keyframe on the way"
        notes.append(
            f"keyframes[{index}] is half a turn away: turned about {_axis(pair)} in the body "
            f"frame; {way} chooses the other way"
        )
    if len(places) > _MOST:
        notes.append(f"{len(places) - _MOST} more keyframes are half a turn from the one before")
    return notes


def _axis(pair: Floats) -> str:
    """Return the axis of the half turn from one orientation to another, in words."""
    axis = between(*align(pair))[1:]
    axis /= np.linalg.norm(axis)
    largest = int(np.argmax(np.abs(axis)))
    if abs(abs(axis[largest]) - 1.0) < 1e-6:
        return ("+" if axis[largest] > 0.0 else "-") + "xyz"[largest]
    return "[" + ", ".join(f"{part:.4g}" for part in np.round(axis, 6)) + "]"
