"""From a motion request to the task of a curve, and from a fitted curve to a request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Protocol, TypeVar

import numpy as np

from orientd.curves import CurveTask, Fit
from orientd.errors import RequestError
from orientd.model import DEFAULT_LIMITS, Keyframe, MotionRequest, Pace
from orientd.planner.timing import Indices, Knots, chord_knots, turn_lengths

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
        return replace(task, times=np.append(0.0, np.cumsum(arcs)))
    knots = _knots(request)
    return replace(
        task,
        keys=request.keys[knots.kept],
        times=0.5 * knots.length * knots.times[knots.kept],
        turns=None if task.turns is None else request.turns[knots.kept][1:],
        is_timed=False,
    )


def distinct(request: MotionRequest) -> Indices:
    """Return the indices of the keyframes that do not repeat the one before."""
    return _knots(request).kept


def _knots(request: MotionRequest) -> Knots:
    """Return the keyframes' times; moves are weighed against turns as no device is known."""
    limits = DEFAULT_LIMITS
    if request.limits is not None:
        limits = replace(
            limits,
            velocity=min(request.limits.velocity, limits.velocity),
            linear_velocity=min(request.limits.linear_velocity, limits.linear_velocity),
        )
    return chord_knots(request, limits, is_uniform=False)


class Planned(Protocol):
    """A plan with the times of its first and last control orientation, s from the beginning."""

    @property
    def start_time(self) -> float: ...  # noqa: D102 - said above

    @property
    def end_time(self) -> float: ...  # noqa: D102 - said above


Plan = TypeVar("Plan", bound=Planned)


def replay_request(
    fit: Fit, *, slower: float | None = None, pace: Pace | None = None
) -> MotionRequest:
    """Return the motion along a fitted spline, with a soft start and end.

    Args:
        fit: of what was recorded.
        slower: how many times as long it is to take; ``None`` leaves that to the planner, which
            makes it as short as the limits permit.
        pace: ``"even"`` keeps the proportions of what was recorded; without *slower* only.
    """
    times = [None] * len(fit.control)
    if slower is not None:
        times = (slower * (fit.times - fit.times[0])).tolist()
    keyframes = [
        Keyframe((w, x, y, z), time)
        for (w, x, y, z), time in zip(fit.control.tolist(), times, strict=True)
    ]
    knots = (fit.knots - fit.knots[0]).tolist()
    options = {"knots": knots}
    return MotionRequest(keyframes, method="kks_bspline", approach=True, options=options, pace=pace)


def plan_as_recorded(
    fit: Fit, plan: Callable[[MotionRequest], Plan]
) -> tuple[Plan, MotionRequest, float]:
    """Plan a fitted spline as fast as it was recorded, or as much slower as the limits ask for.

    Args:
        fit: of what was recorded.
        plan: plans a request.

    Returns:
        The plan, what it was made for, and how many times as long it takes as what was recorded.

    Raises:
        PlanError: it cannot be planned, at whatever speed.
    """
    quickest = plan(replay_request(fit, pace="even"))
    recorded = float(np.ptp(fit.times))
    slower = max(1.0, (quickest.end_time - quickest.start_time) / recorded)
    request = replay_request(fit, slower=slower)
    return plan(request), request, slower
