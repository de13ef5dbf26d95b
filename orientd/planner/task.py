"""From a motion request to the task that every family of curves can be put to."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from orientd.curves import CurveTask
from orientd.errors import RequestError
from orientd.planner.limits import DEFAULT_LIMITS, Limits
from orientd.planner.request import MotionRequest
from orientd.planner.timing import SAME, Indices, move_lengths, radians_per_metre, turn_lengths
from orientd.rotation import Floats

Times = Literal["file", "uniform", "chord"]
OpenEnds = Literal["rest", "natural"]


def task_of(request: MotionRequest, times: Times = "file", ends: OpenEnds = "rest") -> CurveTask:
    """Return the task of a request, without limits, leads or a device.

    With the defaults the curve of a task is the one that is planned.  Where the request has no
    times, that holds up to the pace, and for motions that are at rest at both ends: with a velocity
    there the shape follows from the pace, which the limits of a device decide.

    Args:
        request: keyframes, velocities and turns.
        times: ``"file"`` takes the keyframes' own times; where they have none, each step is given
            as many seconds as half its angle has radians, or longer where its position has further
            to go, and keyframes that repeat the one before are left out.  ``"uniform"`` puts all
            of them a second apart; ``"chord"`` goes by the angles alone.
        ends: what an end is whose velocity is not given: at rest, as of a device that holds (see
            :attr:`.CurveTask.holds`), or natural (without acceleration).

    Raises:
        RequestError: two neighbours are the same, so that there is no chord.
    """
    task = CurveTask(
        keys=request.keys,
        times=np.arange(float(len(request.keys))),
        omega_start=request.omega_start,
        omega_end=request.omega_end,
        turns=request.turns[1:] if np.any(request.turns) else None,
        holds=ends == "rest",
    )
    if times == "uniform":
        return task
    if times == "file" and request.times is not None:
        return replace(task, times=request.times)
    if times == "chord":
        arcs = 0.5 * turn_lengths(request)
        is_same = arcs == 0.0
        if np.any(is_same):
            raise RequestError(
                f"keyframes[{int(np.argmax(is_same)) + 1}]",
                "is the same as the one before it: by chord, neighbours must differ",
            )
        return replace(task, times=_summed(arcs))
    arcs = _way_arcs(request)
    kept = distinct(request)
    if len(kept) < 2:
        raise RequestError("keyframes", "are all the same; give them times to make the device wait")
    return replace(
        task,
        keys=request.keys[kept],
        times=_summed(arcs[kept[1:] - 1]),
        turns=None if task.turns is None else request.turns[kept][1:],
        is_timed=False,
    )


def distinct(request: MotionRequest) -> Indices:
    """Return the indices of the keyframes that do not repeat the one before."""
    return np.flatnonzero(np.concatenate([[True], 2.0 * _way_arcs(request) > SAME]))


def _way_arcs(request: MotionRequest) -> Floats:
    arcs = 0.5 * turn_lengths(request)
    limits = _weights(request.limits)
    moves = move_lengths(request, limits)
    if moves is not None:
        arcs = np.maximum(arcs, 0.5 * moves * radians_per_metre(limits))
    return arcs


def _summed(arcs: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(arcs)])


def _weights(limits: Limits | None) -> Limits:
    """Return limits by which moves are weighed against turns where no device is known."""
    if limits is None:
        return DEFAULT_LIMITS
    return replace(
        DEFAULT_LIMITS,
        velocity=min(limits.velocity, DEFAULT_LIMITS.velocity),
        linear_velocity=min(limits.linear_velocity, DEFAULT_LIMITS.linear_velocity),
    )
