"""From a request to the curve of its method, and errors for unsupported requests.

:mod:`orientd.curves.roles` defines the meaning of keyframes, times and end conditions of a family.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from orientd.curves.contract import METHODS, Curve
from orientd.curves.keyframes import ParameterError
from orientd.curves.roles import CurveTask, UnevenError, is_pair, make_curve, options_of, turns_name
from orientd.errors import PlanError, RequestError
from orientd.model.request import DEFAULT_METHOD, MotionRequest
from orientd.rotation import Floats, angle
from orientd.spelling import did_you_mean

_SAME = 1e-9  # rad; between closer keyframes the axis of a turn is undefined


@dataclass(frozen=True)
class Ends:
    """Velocity and acceleration at both ends of a curve, body frame; ``None`` if not given.

    Attributes:
        omega_start: rad/s.
        omega_end: rad/s.
        alpha_start: rad/s^2; only if the curve continues a motion.
        leaves_freely: whether an end at rest may have an acceleration; see :class:`.CurveTask`.
    """

    omega_start: Floats | None = None
    omega_end: Floats | None = None
    alpha_start: Floats | None = None
    leaves_freely: bool = False

    @cached_property
    def moves(self) -> tuple[bool, bool]:
        """Whether the first and the last keyframe are passed in motion."""
        starts = (self.omega_start, self.alpha_start)
        return (
            any(one is not None and bool(np.any(one)) for one in starts),
            self.omega_end is not None and bool(np.any(self.omega_end)),
        )


def check_method(request: MotionRequest) -> type[Curve]:
    """Return the family of the request's method, if it supports the request.

    Raises:
        RequestError: the method does not exist, takes another number of keyframes, cannot make
            turns or prescribe velocities, or does not have an option.
    """
    name = request.method
    family = METHODS.get(name)
    if family is None:
        hint = did_you_mean(name, METHODS) or "; `orientd methods` lists them"
        raise RequestError("method", f"unknown method {name!r}{hint}")
    if len(request.keys) == 1:
        # A single keyframe needs no curve of the method, only the planner's lead-in.
        return family
    if is_pair(family) and len(request.keys) != 2:
        raise RequestError(
            "keyframes",
            f"{name} takes exactly 2, got {len(request.keys)}; {DEFAULT_METHOD} takes more",
        )
    if request.turns.any():
        _check_turns(request, family)
    for field in ("start_velocity", "end_velocity"):
        if any(getattr(request, field) or ()) and not family.meets_end_velocities:
            able = _names(lambda one: one.meets_end_velocities)
            raise RequestError(field, f"{name} cannot prescribe velocities at its ends; {able} can")
    for option in request.options:
        taken = options_of(family)
        if option not in taken:
            raise RequestError(
                f"options.{option}",
                f"unknown option of {name}{did_you_mean(option, taken)}; "
                f"it takes {', '.join(taken)}",
            )
    return family


def can_turn(family: type[Curve]) -> bool:
    """Return whether a family can make whole turns."""
    return turns_name(family) is not None


def _check_turns(request: MotionRequest, family: type[Curve]) -> None:
    turned = np.flatnonzero(request.turns)
    if not can_turn(family):
        problem = f"{request.method} cannot make whole turns; {_names(can_turn)} can"
        raise RequestError(f"keyframes[{turned[0]}].turns", problem)
    steps = angle(request.keys[turned - 1], request.keys[turned])
    if np.any(steps <= _SAME) and "axis" not in request.options:
        index = int(turned[int(np.argmax(steps <= _SAME))])
        raise RequestError(
            f"keyframes[{index}].turns",
            f"keyframes[{index - 1}] is the same orientation, so the axis of the turn is "
            "undefined; put another keyframe between them",
        )


def build(
    request: MotionRequest, keys: Floats, times: Floats, turns: NDArray[np.int64], ends: Ends
) -> Curve:
    """Return the curve of a request; an end without a velocity is at rest.

    Args:
        request: has the method and its options.
        keys: the keyframes, shape ``(n, 4)``.
        times: their times from 0 on, s, shape ``(n,)``.
        turns: whole turns before each keyframe, shape ``(n,)``.
        ends: velocities at both ends.

    Raises:
        RequestError: the method does not accept an option or the keyframes.
        PlanError: the method has no curve through these keyframes.
    """
    task = CurveTask(
        keys,
        times,
        ends.omega_start,
        ends.omega_end,
        turns[1:] if turns.any() else None,
        alpha_start=ends.alpha_start,
        holds=True,
        leaves_freely=ends.leaves_freely,
        is_timed=request.times is not None,
    )
    return curve_of(request, task)


def curve_of(request: MotionRequest, task: CurveTask) -> Curve:
    """Return the curve of a request's method for a task.

    Raises:
        RequestError: the method does not accept an option or the keyframes.
        PlanError: the method has no curve through these keyframes.
    """
    try:
        return make_curve(METHODS[request.method], task, request.options)
    except UnevenError as error:
        raise RequestError(
            f"keyframes[{error.keyframe}].time",
            f"{request.method} {error}; kks_bspline takes any",
        ) from error
    except PlanError as error:
        raise _cannot_join(request, error) from error
    except ParameterError as error:
        if error.parameter in request.options:
            raise RequestError(f"options.{error.parameter}", str(error)) from error
        if error.parameter in ("keys", "control"):
            raise RequestError("keyframes", f"{request.method}: {error}") from error
        raise _cannot_join(request, error) from error
    except ValueError as error:
        raise _cannot_join(request, error) from error


def _cannot_join(request: MotionRequest, error: Exception) -> PlanError:
    return PlanError(f"{request.method} cannot join these keyframes: {error}")


def _names(is_able: Callable[[type[Curve]], bool]) -> str:
    able = [name for name, family in METHODS.items() if is_able(family)]
    *most, last = able
    return f"{', '.join(most)} and {last}" if most else last
