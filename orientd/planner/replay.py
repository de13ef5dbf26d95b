"""Motions that repeat what was recorded: a fitted spline, as fast as it was or slower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from orientd.curves import Fit
from orientd.errors import LimitError
from orientd.planner.request import Keyframe, MotionRequest, Pace

_STEP = 1.03  # how much slower to try where a limit is broken still
_MOST_ATTEMPTS = 40


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
    slowest = slower * _STEP ** (_MOST_ATTEMPTS - 1)
    while True:
        request = replay_request(fit, slower=slower)
        try:
            return plan(request), request, slower
        except LimitError:
            # Where it ends with a velocity, its lead-out may want more time than its curve.
            if slower > slowest:
                raise
            slower *= _STEP
