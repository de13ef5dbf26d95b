"""From a request to the curve of its method, and what a method can be asked for.

What keyframes, times and conditions at the ends are to a family says :mod:`orientd.curves.roles`,
for the planner as for everybody else; here is what a request may ask of it, and what is wrong with
one that asks for more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from orientd.curves import (
    METHODS,
    Curve,
    CurveTask,
    ParameterError,
    UnevenError,
    is_pair,
    make_curve,
    options_of,
    turns_name,
)
from orientd.errors import PlanError, RequestError
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, Turns
from orientd.rotation import Floats, angle
from orientd.spelling import did_you_mean

_SAME = 1e-9  # rad; keyframes nearer than this leave the axis of a turn open


@dataclass(frozen=True)
class Ends:
    """Velocity and acceleration at both ends of a curve, body frame; ``None`` where not given.

    Attributes:
        omega_start: rad/s.
        omega_end: rad/s.
        alpha_start: rad/s^2; only where the curve continues a motion.
        leaves_freely: whether an end at rest may have an acceleration; see :class:`.CurveTask`.
    """

    omega_start: Floats | None = None
    omega_end: Floats | None = None
    alpha_start: Floats | None = None
    leaves_freely: bool = False

    @cached_property
    def moves(self) -> tuple[bool, bool]:
        """Whether the first keyframe is passed in motion, and the last one."""
        starts = (self.omega_start, self.alpha_start)
        return (
            any(one is not None and bool(np.any(one)) for one in starts),
            self.omega_end is not None and bool(np.any(self.omega_end)),
        )


@dataclass(frozen=True, slots=True)
class Method:
    """What a family of curves can be asked for in a request.

    Attributes:
        is_pair: whether it takes exactly two keyframes.
        has_velocities: whether end velocities can be prescribed.
        has_accelerations: whether the acceleration at the start can be, too.
        has_turns: whether it can make whole turns.
        options: what the user may set.
    """

    is_pair: bool
    has_velocities: bool
    has_accelerations: bool
    has_turns: bool
    options: tuple[str, ...]


@lru_cache(maxsize=256)
def method_of(name: str) -> Method | None:
    """Return what a method can be asked for; ``None`` if there is no such method."""
    family = METHODS.get(name)
    if family is None:
        return None
    return Method(
        is_pair=is_pair(family),
        has_velocities=family.meets_end_velocities,
        has_accelerations=family.meets_end_accelerations,
        has_turns=turns_name(family) is not None,
        options=options_of(family),
    )


def check_method(request: MotionRequest) -> Method:
    """Return what the request's method can be asked for, if the method can do what is asked.

    Raises:
        RequestError: there is no such method, it takes another number of keyframes, it cannot make
            turns or prescribe velocities that are asked for, or an option is not one of its own.
    """
    name = request.method
    method = method_of(name)
    if method is not None and request.is_single:
        # There is no curve of the method's; the way to the keyframe is the planner's.
        return method
    if method is None:
        raise RequestError("method", f"unknown method {name!r}{did_you_mean(name, METHODS)}")
    if method.is_pair and len(request.keyframes) != 2:
        raise RequestError(
            "keyframes",
            f"{name} takes exactly 2, got {len(request.keyframes)}; {DEFAULT_METHOD} takes more",
        )
    if not method.has_turns and request.turns.any():
        index = int(np.argmax(request.turns != 0))
        able = _names(lambda method: method.has_turns)
        raise RequestError(
            f"keyframes[{index}].turns", f"{name} cannot make whole turns; {able} can"
        )
    if request.turns.any():
        _check_axes(request)
    for field, velocity in (
        ("start_velocity", request.start_velocity),
        ("end_velocity", request.end_velocity),
    ):
        if velocity is not None and any(velocity) and not method.has_velocities:
            able = _names(lambda method: method.has_velocities)
            raise RequestError(field, f"{name} cannot prescribe velocities at its ends; {able} can")
    for option in request.options:
        if option not in method.options:
            raise RequestError(
                f"options.{option}",
                f"unknown option of {name}{did_you_mean(option, method.options)}; "
                f"it takes {', '.join(method.options)}",
            )
    return method


def _check_axes(request: MotionRequest) -> None:
    turned = np.flatnonzero(request.turns)
    steps = angle(request.keys[turned - 1], request.keys[turned])
    if np.any(steps <= _SAME) and "axis" not in request.options:
        index = int(turned[int(np.argmax(steps <= _SAME))])
        raise RequestError(
            f"keyframes[{index}].turns",
            f"keyframes[{index - 1}] is the same orientation, which leaves the axis to turn about "
            "open; put another keyframe between them",
        )


def build(request: MotionRequest, keys: Floats, times: Floats, turns: Turns, ends: Ends) -> Curve:
    """Return the curve of a request.

    Ends whose velocities are not given are those of a device that holds.

    Args:
        request: for the method and its options.
        keys: the keyframes, shape ``(n, 4)``.
        times: their times from 0 on, s, shape ``(n,)``.
        turns: whole turns before each keyframe, shape ``(n,)``.
        ends: velocities at both ends.

    Raises:
        RequestError: an option or the keyframes are not what the method takes.
        PlanError: the method cannot join these keyframes.
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
    """Return the curve of a request's method that does a task of it.

    Raises:
        RequestError: an option or the keyframes are not what the method takes.
        PlanError: the method cannot join these keyframes.
    """
    try:
        return make_curve(METHODS[request.method], task, request.options)
    except UnevenError as error:
        raise RequestError(
            f"keyframes[{error.keyframe}].time",
            f"{request.method} {error}; kks_bspline takes any",
        ) from error
    except PlanError as error:
        raise PlanError(f"{request.method} cannot join these keyframes: {error}") from error
    except ParameterError as error:
        if error.parameter in request.options:
            raise RequestError(f"options.{error.parameter}", str(error)) from error
        if error.parameter in ("keys", "control"):
            raise RequestError("keyframes", f"{request.method}: {error}") from error
        raise PlanError(f"{request.method} cannot join these keyframes: {error}") from error
    except ValueError as error:
        raise PlanError(f"{request.method} cannot join these keyframes: {error}") from error


def _names(is_able: Callable[[Method], bool]) -> str:
    able = [name for name in METHODS if (method := method_of(name)) and is_able(method)]
    *most, last = able
    return f"{', '.join(most)} and {last}" if most else last
