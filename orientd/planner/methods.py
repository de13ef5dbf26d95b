"""From a request to the parameters of its method: one row for every family of curves.

A row says what the keyframes are to the method (keyframes to pass at their times, the two ends of
one segment, or control quaternions), whether it can prescribe velocities at the ends, which of its
parameters takes whole turns, and which options the user may set.  Everything else is the planner's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from orientd.curves import METHODS, Curve
from orientd.errors import PlanError, RequestError
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, Turns
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True)
class Ends:
    """Velocity and acceleration at both ends of a curve, body frame; ``None`` where not given.

    Attributes:
        omega_start: rad/s.
        omega_end: rad/s.
        alpha_start: rad/s^2; only where the curve continues a motion.
    """

    omega_start: Floats | None = None
    omega_end: Floats | None = None
    alpha_start: Floats | None = None


Parameters = Callable[[Floats, Floats, Ends], dict[str, Any]]
"""From keyframes ``(n, 4)``, their times from 0 on ``(n,)`` and the ends to keyword arguments."""


def _keys(keys: Floats, times: Floats, _: Ends) -> dict[str, Any]:
    return {"keys": keys, "times": times}


def _keys_with_velocities(keys: Floats, times: Floats, ends: Ends) -> dict[str, Any]:
    return {
        "keys": keys,
        "times": times,
        "omega_start": _or_zero(ends.omega_start),
        "omega_end": _or_zero(ends.omega_end),
    }


def _cumulative(keys: Floats, times: Floats, ends: Ends) -> dict[str, Any]:
    # From rest a motion begins without a step in torque: velocity and acceleration both given.
    # With a velocity the run-up, or whatever comes before, supplies the acceleration.
    parameters = _keys_with_velocities(keys, times, ends)
    for end, alpha in (("start", ends.alpha_start), ("end", None)):
        is_moving = bool(np.any(parameters[f"omega_{end}"]))
        if is_moving and alpha is None:
            parameters[end] = "clamped"
        else:
            parameters[end] = "state"
            parameters[f"alpha_{end}"] = _or_zero(alpha)
    return parameters


def _pair(keys: Floats, times: Floats, _: Ends) -> dict[str, Any]:
    return {"q0": keys[0], "q1": keys[1], "t0": float(times[0]), "t1": float(times[-1])}


def _pair_with_velocities(keys: Floats, times: Floats, ends: Ends) -> dict[str, Any]:
    return {
        **_pair(keys, times, ends),
        "omega0": _or_zero(ends.omega_start),
        "omega1": _or_zero(ends.omega_end),
    }


def _pair_with_accelerations(keys: Floats, times: Floats, ends: Ends) -> dict[str, Any]:
    return {
        **_pair_with_velocities(keys, times, ends),
        "alpha0": _or_zero(ends.alpha_start),
        "alpha1": np.zeros(3),
    }


def _bezier(keys: Floats, times: Floats, _: Ends) -> dict[str, Any]:
    # Keyframes come with either sign; the curve takes its control quaternions as they are.
    return {"control": keys, "t0": float(times[0]), "t1": float(times[-1]), "align": True}


def _bspline(keys: Floats, times: Floats, _: Ends, *, order: int = 4) -> dict[str, Any]:
    """Return control quaternions with clamped knots that average the times (Piegl, Tiller 9.8)."""
    order = min(order, len(keys))
    degree = order - 1
    sums = np.concatenate([[0.0], np.cumsum(times)])
    inner = (sums[degree + 1 : len(keys)] - sums[1 : len(keys) - degree]) / degree
    knots = np.concatenate([np.full(order, times[0]), inner, np.full(order, times[-1])])
    return {"control": keys, "order": order, "knots": knots}


def _uniform(keys: Floats, times: Floats, _: Ends) -> dict[str, Any]:
    steps = np.diff(times)
    if np.ptp(steps) > 1e-9 * times[-1]:
        index = int(np.argmax(np.abs(steps - steps[0]))) + 1
        raise RequestError(
            f"keyframes[{index}].time",
            f"kks_uniform needs equal intervals, got {steps[index - 1]:.6g} s after "
            f"{steps[0]:.6g} s; kks_bspline takes any",
        )
    return {"control": keys}


def _or_zero(vector: Floats | None) -> Floats:
    return np.zeros(3) if vector is None else vector


@dataclass(frozen=True, slots=True)
class Method:
    """How a family of curves is made from a request.

    Attributes:
        parameters: makes the keyword arguments.
        is_pair: whether it takes exactly two keyframes.
        has_velocities: whether end velocities can be prescribed.
        has_accelerations: whether the acceleration at the start can be, too.
        turns: the parameter that takes whole turns; ``None`` if there is none.
        is_interpolating: whether times say when a keyframe is passed.
        options: what the user may set.
    """

    parameters: Parameters
    is_pair: bool = False
    has_velocities: bool = False
    has_accelerations: bool = False
    turns: str | None = None
    is_interpolating: bool = True
    options: tuple[str, ...] = ("align",)


TABLE: dict[str, Method] = {
    "slerp": Method(_pair, is_pair=True, turns="spins", options=("path", "axis")),
    "piecewise_slerp": Method(_keys),
    "kks_bezier": Method(_bezier, is_interpolating=False),
    "kks_hermite": Method(
        _pair_with_velocities,
        is_pair=True,
        has_velocities=True,
        turns="revolutions",
        options=("product", "align"),
    ),
    "kks_quintic_hermite": Method(
        _pair_with_accelerations,
        is_pair=True,
        has_velocities=True,
        has_accelerations=True,
        turns="revolutions",
    ),
    "kks_hermite_spline": Method(
        _keys_with_velocities, has_velocities=True, options=("rule", "align")
    ),
    "kks_bspline": Method(_bspline, is_interpolating=False, options=("order", "align")),
    "kks_uniform": Method(_uniform, is_interpolating=False),
    "c2_cumulative": Method(
        _cumulative, has_velocities=True, has_accelerations=True, turns="turns"
    ),
}


def check_method(request: MotionRequest) -> Method:
    """Return the row of the request's method, if the method can do what is asked.

    Raises:
        RequestError: there is no such method, it takes another number of keyframes, it cannot make
            turns or prescribe velocities that are asked for, or an option is not one of its own.
    """
    name = request.method
    method = TABLE.get(name) if name in METHODS else None
    if method is None:
        raise RequestError("method", f"unknown method {name!r}{did_you_mean(name, _planned())}")
    if method.is_pair and len(request.keyframes) != 2:
        raise RequestError(
            "keyframes",
            f"{name} takes exactly 2, got {len(request.keyframes)}; {DEFAULT_METHOD} takes more",
        )
    if method.turns is None and np.any(request.turns):
        index = int(np.argmax(request.turns != 0))
        able = _names(lambda row: row.turns is not None)
        raise RequestError(
            f"keyframes[{index}].turns", f"{name} cannot make whole turns; {able} can"
        )
    for field, velocity in (
        ("start_velocity", request.start_velocity),
        ("end_velocity", request.end_velocity),
    ):
        if velocity is not None and any(velocity) and not method.has_velocities:
            able = _names(lambda row: row.has_velocities)
            raise RequestError(field, f"{name} cannot prescribe velocities at its ends; {able} can")
    for option in request.options:
        if option not in method.options:
            raise RequestError(
                f"options.{option}",
                f"unknown option of {name}{did_you_mean(option, method.options)}; "
                f"it takes {', '.join(method.options)}",
            )
    return method


def build(request: MotionRequest, keys: Floats, times: Floats, turns: Turns, ends: Ends) -> Curve:
    """Return the curve of a request.

    Args:
        request: for the method and its options.
        keys: the keyframes, shape ``(n, 4)``.
        times: their times from 0 on, s, shape ``(n,)``.
        turns: whole turns before each keyframe, shape ``(n,)``.
        ends: velocities at both ends.

    Raises:
        RequestError: an option is not one that the method takes.
        PlanError: the method cannot join these keyframes.
    """
    method = TABLE[request.method]
    options = dict(request.options)
    if request.method == "kks_bspline":
        parameters = _bspline(keys, times, ends, order=_order(options.pop("order", 4)))
    else:
        parameters = method.parameters(keys, times, ends)
    if method.turns is not None and np.any(turns):
        parameters[method.turns] = int(turns[-1]) if method.is_pair else turns[1:].tolist()
    try:
        return METHODS[request.method](**{**parameters, **options})
    except (ValueError, TypeError) as error:
        for option in options:
            if str(error).startswith(option):
                raise RequestError(f"options.{option}", str(error)) from error
        raise PlanError(f"{request.method} cannot join these keyframes: {error}") from error


def _order(order: object) -> int:
    # Numbers of a protobuf Struct are floating ones.
    if isinstance(order, bool) or not isinstance(order, (int, float)) or order != int(order):
        raise RequestError("options.order", f"expected a whole number, got {order!r}")
    if order < 2:
        raise RequestError("options.order", f"must be at least 2, got {int(order)}")
    return int(order)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a hint at the nearest of the *known* names, or an empty string."""
    near = get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def _planned() -> list[str]:
    return [name for name in TABLE if name in METHODS]


def _names(is_able: Callable[[Method], bool]) -> str:
    *most, last = [name for name in _planned() if is_able(TABLE[name])]
    return f"{', '.join(most)} and {last}" if most else last
