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
    """What planning says of the times of a motion."""

    @property
    def start_time(self) -> float:
        """When the first control orientation is reached, s from the beginning."""

    @property
    def end_time(self) -> float:
        """When the last one is reached."""


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
    times = fit.times - fit.times[0]
    keyframes = [
        Keyframe((w, x, y, z), None if slower is None else time)
        for (w, x, y, z), time in zip(
            fit.control.tolist(), ((slower or 1.0) * times).tolist(), strict=True
        )
    ]
    knots = (fit.knots - fit.knots[0]).tolist()
    return MotionRequest(
        keyframes,
        method="kks_bspline",
        approach=True,
        options={"knots": knots},
        pace=pace,
    )


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
    for _ in range(_MOST_ATTEMPTS - 1):
        request = replay_request(fit, slower=slower)
        try:
            return plan(request), request, slower
        except LimitError:
            # Where it ends with a velocity, its lead-out may want more time than its curve.
            slower *= _STEP
    request = replay_request(fit, slower=slower)
    return plan(request), request, slower
