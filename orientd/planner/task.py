"""From a motion request to the task that every family of curves can be put to."""

from __future__ import annotations

from typing import Literal

import numpy as np

from orientd.curves import Task
from orientd.errors import RequestError
from orientd.planner.request import MotionRequest
from orientd.rotation import Floats, angle

Times = Literal["file", "uniform", "chord"]


def task_of(request: MotionRequest, times: Times = "file") -> Task:
    """Return the task of a request, without limits, leads or a device.

    Args:
        request: keyframes, velocities and turns.
        times: ``"file"`` takes the keyframes' own times, or ``"chord"`` where they have none;
            ``"uniform"`` puts them a second apart; ``"chord"`` gives each step as many seconds as
            half its angle has radians.

    Raises:
        RequestError: two neighbours are the same, so that there is no chord.
    """
    instants = request.times if times == "file" else None
    if instants is None:
        instants = (
            np.arange(float(len(request.keys))) if times == "uniform" else _chord_times(request)
        )
    turns = request.turns[1:]
    return Task(
        keys=request.keys,
        times=instants,
        omega_start=request.omega_start,
        omega_end=request.omega_end,
        turns=turns if np.any(turns) else None,
    )


def _chord_times(request: MotionRequest) -> Floats:
    steps = 0.5 * angle(request.keys[1:], request.keys[:-1]) + np.pi * np.abs(request.turns[1:])
    is_same = steps == 0.0
    if np.any(is_same):
        raise RequestError(
            f"keyframes[{int(np.argmax(is_same)) + 1}]",
            "is the same as the one before it: without times, neighbours must differ",
        )
    return np.concatenate([[0.0], np.cumsum(steps)])
