"""From a request to the parameters of its method: one row for every family of curves.

A row says what the keyframes are to the method (keyframes to pass at their times, the two ends of
one segment, or control quaternions), whether it can prescribe velocities at the ends, which of its
parameters takes whole turns, and which options the user may set.  Everything else is the planner's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np

from orientd.curves import EQUAL, METHODS, Curve, averaged_knots
from orientd.errors import PlanError, RequestError
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, Turns
from orientd.rotation import Floats, angle
from orientd.spelling import did_you_mean

_SAME = 1e-9  # rad; keyframes nearer than this leave the axis of a turn open


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


@dataclass(frozen=True, slots=True)
class Given:
    """What the parameters of a method are made from.

    Attributes:
        keys: the keyframes, shape ``(n, 4)``.
        times: their times from 0 on, s, shape ``(n,)``.
        ends: velocities at both ends.
        options: what the user has set.
    """

    keys: Floats
    times: Floats
    ends: Ends
    options: Mapping[str, Any]


Parameters = Callable[[Given], dict[str, Any]]


def _keys(given: Given) -> dict[str, Any]:
    return {"keys": given.keys, "times": given.times}


def _keys_with_velocities(given: Given) -> dict[str, Any]:
    return {
        **_keys(given),
        "omega_start": _or_zero(given.ends.omega_start),
        "omega_end": _or_zero(given.ends.omega_end),
    }


def _cumulative(given: Given) -> dict[str, Any]:
    # From rest a motion begins without a step in torque: velocity and acceleration both given.
    # With a velocity the run-up, or whatever comes before, supplies the acceleration.
    parameters = _keys_with_velocities(given)
    for end, alpha in (("start", given.ends.alpha_start), ("end", None)):
        is_moving = bool(np.any(parameters[f"omega_{end}"]))
        if is_moving and alpha is None:
            parameters[end] = "clamped"
        else:
            parameters[end] = "state"
            parameters[f"alpha_{end}"] = _or_zero(alpha)
    return parameters


def _interval(given: Given) -> dict[str, Any]:
    return {"t0": float(given.times[0]), "t1": float(given.times[-1])}


def _pair(given: Given) -> dict[str, Any]:
    return {"q0": given.keys[0], "q1": given.keys[1], **_interval(given)}


def _pair_with_velocities(given: Given) -> dict[str, Any]:
    return {
        **_pair(given),
        "omega0": _or_zero(given.ends.omega_start),
        "omega1": _or_zero(given.ends.omega_end),
    }


def _pair_with_accelerations(given: Given) -> dict[str, Any]:
    return {
        **_pair_with_velocities(given),
        "alpha0": _or_zero(given.ends.alpha_start),
        "alpha1": np.zeros(3),
    }


def _bezier(given: Given) -> dict[str, Any]:
    # Keyframes come with either sign.
    return {"control": given.keys, "align": given.options.get("align", True), **_interval(given)}


def _bspline(given: Given) -> dict[str, Any]:
    order = min(_order(given.options.get("order", 4)), len(given.keys))
    wanted = given.options.get("knots")
    if wanted is None:
        knots = averaged_knots(given.times, order)
    else:
        knots = _on_the_clock(wanted, given.times, order)
    return {"control": given.keys, "order": order, "knots": knots}


def _on_the_clock(knots: object, times: Floats, order: int) -> Floats:
    """Return knots of the user's, in any unit, with the curve they bound as long as *times*."""
    expected = f"expected {len(times) + order} numbers that do not decrease"
    try:
        vector = np.asarray(knots, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RequestError("options.knots", expected) from error
    if vector.shape != (len(times) + order,) or not np.all(np.isfinite(vector)):
        raise RequestError("options.knots", f"{expected}, got {np.size(vector)}")
    begin, end = vector[order - 1], vector[-order]
    if np.any(np.diff(vector) < 0.0) or not end > begin:
        raise RequestError("options.knots", f"{expected}, and span some time")
    mapped: Floats = times[0] + (vector - begin) * ((times[-1] - times[0]) / (end - begin))
    mapped[order - 1], mapped[-order] = times[0], times[-1]
    # Rounding must not put a knot that is repeated at an end on either side of it.
    return np.maximum.accumulate(np.where(vector >= end, np.maximum(mapped, times[-1]), mapped))


def _order(order: object) -> int:
    if isinstance(order, bool) or not isinstance(order, int) or order < 2:
        raise RequestError("options.order", f"expected a whole number from 2 on, got {order!r}")
    return order


def _uniform(given: Given) -> dict[str, Any]:
    steps = np.diff(given.times)
    if np.ptp(steps) > EQUAL * given.times[-1]:
        index = int(np.argmax(np.abs(steps - steps[0]))) + 1
        raise RequestError(
            f"keyframes[{index}].time",
            f"kks_uniform needs equal intervals, got {steps[index - 1]:.6g} s after "
            f"{steps[0]:.6g} s; kks_bspline takes any",
        )
    return {"control": given.keys}


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
        options: what the user may set.
    """

    parameters: Parameters
    is_pair: bool = False
    has_velocities: bool = False
    has_accelerations: bool = False
    turns: str | None = None
    options: tuple[str, ...] = ("align",)


TABLE: dict[str, Method] = {
    "slerp": Method(_pair, is_pair=True, turns="spins", options=("path", "axis")),
    "piecewise_slerp": Method(_keys),
    "kks_bezier": Method(_bezier),
    "kks_hermite": Method(
        _pair_with_velocities,
        is_pair=True,
        has_velocities=True,
        turns="revolutions",
        options=("product", "revolutions", "align"),
    ),
    "kks_quintic_hermite": Method(
        _pair_with_accelerations,
        is_pair=True,
        has_velocities=True,
        has_accelerations=True,
        turns="revolutions",
        options=("revolutions", "align"),
    ),
    "kks_hermite_spline": Method(
        _keys_with_velocities, has_velocities=True, options=("rule", "align")
    ),
    "kks_bspline": Method(_bspline, options=("order", "knots", "align")),
    "kks_uniform": Method(_uniform),
    "c2_cumulative": Method(
        _cumulative, has_velocities=True, has_accelerations=True, turns="turns"
    ),
    "minimum_effort": Method(
        _cumulative,
        has_velocities=True,
        has_accelerations=True,
        options=("inertia", "order", "smoothness", "spans", "align"),
    ),
}


def method_of(name: str) -> Method | None:
    """Return the row of a method; ``None`` if there is no such method, or none for keyframes.

    A family that takes keyframes at times and nothing else of the planner's needs no row.
    """
    family = METHODS.get(name)
    if family is None:
        return None
    if name in TABLE:
        return TABLE[name]
    parameters = tuple(signature(family).parameters)
    for roles, made in (
        ({"keys", "times"}, _keys),
        ({"control", "order", "knots"}, _bspline),
        ({"control", "t0", "t1"}, _bezier),
    ):
        if roles <= set(parameters):
            options = tuple(p for p in parameters if p == "order" or p not in roles)
            return Method(made, options=options)
    return None


def check_method(request: MotionRequest) -> Method:
    """Return the row of the request's method, if the method can do what is asked.

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
        known = [other for other in METHODS if method_of(other) is not None]
        raise RequestError("method", f"unknown method {name!r}{did_you_mean(name, known)}")
    if method.is_pair and len(request.keyframes) != 2:
        raise RequestError(
            "keyframes",
            f"{name} takes exactly 2, got {len(request.keyframes)}; {DEFAULT_METHOD} takes more",
        )
    if method.turns is None and request.turns.any():
        index = int(np.argmax(request.turns != 0))
        able = _names(lambda row: row.turns is not None)
        raise RequestError(
            f"keyframes[{index}].turns", f"{name} cannot make whole turns; {able} can"
        )
    _check_axes(request)
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


def _check_axes(request: MotionRequest) -> None:
    if not request.turns.any():
        return
    turned = np.flatnonzero(request.turns)
    steps = angle(request.keys[turned - 1], request.keys[turned])
    if np.any(steps <= _SAME) and "axis" not in request.options:
        index = int(turned[int(np.argmax(steps <= _SAME))])
        raise RequestError(
            f"keyframes[{index}].turns",
            f"keyframes[{index - 1}] is the same orientation, which leaves the axis to turn about "
            "open; put another keyframe between them",
        )


def build(
    request: MotionRequest, method: Method, keys: Floats, times: Floats, turns: Turns, ends: Ends
) -> Curve:
    """Return the curve of a request.

    Args:
        request: for the options.
        method: the row of the request's method.
        keys: the keyframes, shape ``(n, 4)``.
        times: their times from 0 on, s, shape ``(n,)``.
        turns: whole turns before each keyframe, shape ``(n,)``.
        ends: velocities at both ends.

    Raises:
        RequestError: an option or the keyframes are not what the method takes.
        PlanError: the method cannot join these keyframes.
    """
    options = dict(request.options)
    parameters = method.parameters(Given(keys, times, ends, options))
    if method.turns is not None and np.any(turns):
        parameters[method.turns] = int(turns[-1]) if method.is_pair else turns[1:].tolist()
    try:
        return METHODS[request.method](**{**options, **parameters})
    except (ValueError, TypeError) as error:
        for option in options:
            if str(error).startswith(option):
                raise RequestError(f"options.{option}", str(error)) from error
        for role in ("keys ", "control "):
            if str(error).startswith(role):
                problem = f"{request.method}: {str(error).removeprefix(role)}"
                raise RequestError("keyframes", problem) from error
        raise PlanError(f"{request.method} cannot join these keyframes: {error}") from error


def _names(is_able: Callable[[Method], bool]) -> str:
    *most, last = [name for name, method in TABLE.items() if is_able(method)]
    return f"{', '.join(most)} and {last}" if most else last
