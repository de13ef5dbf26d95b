"""From a motion request to the task of a curve, and from a fitted curve to a request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, Protocol, TypeVar

import numpy as np

from orientd.curves.fitting import Fit
from orientd.curves.roles import CurveTask
from orientd.errors import PlanError, RequestError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest, Pace
from orientd.planner.timing.knots import SAME, Indices, Knots, chord_knots, turn_lengths
from orientd.rotation import angle

Times = Literal["file", "uniform", "chord"]
OpenEnds = Literal["rest", "natural"]


def task_of(request: MotionRequest, times: Times = "file", ends: OpenEnds = "rest") -> CurveTask:
    """Return the task of a request, without limits, leads or a device.

    With the defaults, the curve of a task is the planned one.  Without times in the request, that
    holds for its shape but not for its pace, and only for motions at rest at both ends.  With a
    velocity at an end the shape follows from the pace, which depends on the limits of a device.

    Args:
        request: keyframes, velocities and turns.
        times: ``"file"`` uses the keyframes' own times.  If they have none, each step takes half
            its angle in rad as seconds, or longer if its position moves further, and repeated
            keyframes are left out.  ``"uniform"`` puts all of them a second apart; ``"chord"`` uses
            the angles alone.
        ends: the condition of an end without a velocity: at rest, as of a device that holds (see
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
    """Return the indices of the keyframes that differ from the one before."""
    return _knots(request).kept


def _knots(request: MotionRequest) -> Knots:
    """Return the keyframes' times; without a device, moves have a default weight against turns."""
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
        fit: fit of a recording.
        slower: factor of the duration; ``None`` leaves it to the planner, which makes the motion as
            short as the limits permit.
        pace: ``"even"`` keeps the relative timing of the recording; only without *slower*.

    Raises:
        PlanError: the fit does not turn.
    """
    if not (angle(fit.control[1:], fit.control[:-1]) > SAME).any():
        raise PlanError(
            f"the recording is at rest: its {len(fit.samples.times)} samples have one orientation; "
            "there is nothing to replay"
        )
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
    """Plan a fitted spline at the speed of the recording, or as much slower as the limits require.

    Args:
        fit: fit of a recording.
        plan: plans a request.

    Returns:
        The plan, its request, and its duration relative to the recording.

    Raises:
        PlanError: it cannot be planned at any speed.
    """
    quickest = plan(replay_request(fit, pace="even"))
    recorded = float(np.ptp(fit.times))
    slower = max(1.0, (quickest.end_time - quickest.start_time) / recorded)
    request = replay_request(fit, slower=slower)
    return plan(request), request, slower
