"""Checks of parameters that curve families share: keyframes, times, knots, ends, choices.

Also the comparison of two sets of parameters.

Every check returns the parameter as a new array or number, or raises a :class:`ParameterError` with
the parameter, the allowed values and the given one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats, align, between, log_half
from orientd.tolerances import NORM_TOLERANCE, ROUNDING

EndState = tuple[Floats | None, Floats | None]
"""Body angular velocity, rad/s, and acceleration, rad/s^2, at an end; ``None`` if not given."""

VELOCITY_ENDS = {"natural": (0, 0), "clamped": (1, 1)}
STATE_ENDS = {**VELOCITY_ENDS, "state": (2, 2)}
"""End conditions: how many of velocity and acceleration must be given, and how many may be."""


class ParameterError(ValueError):
    """A parameter that the family does not accept.

    Attributes:
        parameter: its name.
    """

    def __init__(self, parameter: str, problem: str) -> None:
        super().__init__(parameter, problem)
        self.parameter = parameter
        self._problem = problem

    def __str__(self) -> str:
        return self._problem


def check_numbers(value: object, name: str, expected: str) -> Floats:
    """Return numbers as a new array; *expected* describes the allowed values for errors."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.copy()
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ParameterError(name, f"{name} must be {expected}, got {value!r}") from error
    if array.dtype.kind not in "iuf":
        raise ParameterError(name, f"{name} must be {expected}, got {value!r}")
    return array.astype(np.float64, order="C")


def _unit(array: Floats, name: str) -> Floats:
    norm = np.sqrt(np.einsum("...i,...i->...", array, array))
    error = np.abs(norm - 1.0)
    if (error <= ROUNDING).all():
        return array
    _check_finite(array, name)
    is_off = error > NORM_TOLERANCE
    if is_off.any():
        place = int(np.argmax(is_off))
        where = f"{name}[{place}]" if array.ndim == 2 else name
        raise ParameterError(
            name,
            f"{where} must have norm 1 within {NORM_TOLERANCE:g}, "
            f"got {array.reshape(-1, 4)[place].tolist()} of norm {norm.flat[place]:.9g}",
        )
    # Dividing an exact unit quaternion would only add rounding to small steps.
    unit: Floats = np.where((error <= ROUNDING)[..., None], array, array / norm[..., None])
    return unit


def _check_finite(array: Floats, name: str) -> None:
    is_bad = ~np.isfinite(array)
    if is_bad.any():
        place = np.unravel_index(int(np.argmax(is_bad)), array.shape)
        index = ", ".join(str(int(i)) for i in place)
        raise ParameterError(
            name, f"{name} must be finite, got {float(array[place])!r} at [{index}]"
        )


def check_quaternion(value: object, name: str) -> Floats:
    """Return one unit quaternion ``(w, x, y, z)``, normalised to rounding, shape ``(4,)``."""
    array = check_numbers(value, name, "a unit quaternion (w, x, y, z)")
    if array.shape != (4,):
        raise ParameterError(name, f"{name} must be a unit quaternion (w, x, y, z), got {value!r}")
    return _unit(array, name)


def check_keys(value: object, name: str = "keys", *, minimum: int = 2) -> Floats:
    """Return a list of unit quaternions, normalised to rounding, signs as given, ``(n, 4)``.

    Raises:
        ValueError: there are fewer than *minimum*, or one is not a unit quaternion within 1e-6.
    """
    expected = f"a list of at least {minimum} unit quaternions (w, x, y, z)"
    array = check_numbers(value, name, expected)
    if array.ndim != 2 or array.shape[-1] != 4 or len(array) < minimum:
        raise ParameterError(
            name, f"{name} must be {expected}, got an array of shape {array.shape}"
        )
    return _unit(array, name)


def check_aligned(
    value: object, align_signs: object, name: str = "keys", *, minimum: int = 2
) -> Floats:
    """Return checked keyframes; *align_signs* aligns their signs from the first one on."""
    keys = check_keys(value, name, minimum=minimum)
    return align(keys) if check_bool(align_signs, "align") else keys


def check_vector(value: object, name: str, length: int = 3) -> Floats:
    """Return one finite vector, shape ``(length,)``."""
    array = check_numbers(value, name, f"a vector of {length} numbers")
    if array.shape != (length,) or not np.isfinite(array).all():
        raise ParameterError(
            name, f"{name} must be a vector of {length} finite numbers, got {value!r}"
        )
    return array


def check_number(value: object, name: str) -> float:
    """Return a finite number."""
    array = check_numbers(value, name, "a finite number")
    if array.ndim != 0 or not math.isfinite(array):
        raise ParameterError(name, f"{name} must be a finite number, got {value!r}")
    return float(array)


def check_integer(
    value: object, name: str, *, minimum: int | None = None, maximum: int | None = None
) -> int:
    """Return a whole number, given as an int or as a float without a fraction."""
    expected = "a whole number" if minimum is None else f"a whole number of at least {minimum}"
    array = check_numbers(value, name, expected)
    if array.ndim != 0 or not math.isfinite(array) or float(array) % 1.0:
        raise ParameterError(name, f"{name} must be {expected}, got {value!r}")
    if maximum is not None:
        expected = str(minimum) if minimum == maximum else f"{minimum} to {maximum}"
    if (minimum is not None and array < minimum) or (maximum is not None and array > maximum):
        raise ParameterError(name, f"{name} must be {expected}, got {value!r}")
    return round(float(array))


def check_bool(value: object, name: str) -> bool:
    """Return a boolean."""
    if not isinstance(value, bool | np.bool_):
        raise ParameterError(name, f"{name} must be True or False, got {value!r}")
    return bool(value)


def check_choice(value: object, name: str, allowed: Collection[str]) -> str:
    """Return a word that must be one of the allowed ones."""
    if not isinstance(value, str) or value not in allowed:
        words = ", ".join(repr(word) for word in allowed)
        raise ParameterError(name, f"{name} must be one of {words}, got {value!r}")
    return value


def check_end(
    side: str,
    condition: object,
    omega: ArrayLike | None,
    alpha: ArrayLike | None = None,
    conditions: Mapping[str, tuple[int, int]] = VELOCITY_ENDS,
) -> EndState:
    """Return the checked angular velocity and acceleration at an end.

    Args:
        side: ``"start"`` or ``"end"``, as in the names of the parameters.
        condition: one of *conditions*.
        omega: velocity.
        alpha: acceleration.
        conditions: the conditions of the family, as in ``STATE_ENDS``.
    """
    word = check_choice(condition, side, conditions)
    least, most = conditions[word]
    for count, (quantity, value) in enumerate((("omega", omega), ("alpha", alpha)), start=1):
        name = f"{quantity}_{side}"
        if value is None and count <= least:
            raise ParameterError(name, f"{name} must be given for {side}={word!r}, got None")
        if value is not None and count > most:
            others = [f"; use {side}={one!r}" for one in conditions if conditions[one][1] >= count]
            raise ParameterError(
                name,
                f"{name} must be None with {side}={word!r}, got {value!r}{''.join(others[:1])}",
            )
    return (
        None if omega is None else check_vector(omega, f"omega_{side}"),
        None if alpha is None else check_vector(alpha, f"alpha_{side}"),
    )


def check_interval(t0: object, t1: object) -> tuple[float, float]:
    """Return the ends of a time interval in seconds."""
    start, end = check_number(t0, "t0"), check_number(t1, "t1")
    if not end > start:
        raise ParameterError("t1", f"t1 must be greater than t0 = {start!r}, got {end!r}")
    return start, end


def _check_order(array: Floats, name: str, is_wrong: np.ndarray, said: str) -> None:
    """Refuse numbers whose sequence is not as *said*."""
    if is_wrong.any():
        i = int(np.argmax(is_wrong))
        raise ParameterError(
            name,
            f"{name} must {said}, got {name}[{i + 1}] = {float(array[i + 1])!r} "
            f"after {name}[{i}] = {float(array[i])!r}",
        )


def resolve_times(times: object, keys: Floats, turns: ArrayLike | None = None) -> Floats:
    """Return the times of the keyframes, in seconds.

    ``"uniform"`` gives 0, 1, 2, ...; ``"chord"`` starts at 0 and gives each interval the length
    of its half-angle arc, ``|log(q_i^-1 q_{i+1})|`` (Nielson, 1993, eq. 23, whose arcs are of
    half the physical angle).  The signs of the keyframes count.

    Args:
        times: ``"uniform"``, ``"chord"`` or a strictly increasing number for each keyframe;
            ``None`` is ``"chord"``.
        keys: unit quaternions as the curve will use them, shape ``(n, 4)``.
        turns: whole turns in each interval, each of which adds pi to its arc.

    Returns:
        Strictly increasing times, shape ``(n,)``.

    Raises:
        ValueError: *times* is neither a word nor a valid list, or ``"chord"`` finds two equal
            neighbours.
    """
    count = len(keys)
    if times is None:
        times = "chord"
    if isinstance(times, str):
        if check_choice(times, "times", ("uniform", "chord")) == "uniform":
            return np.arange(count, dtype=np.float64)
        arcs = np.sqrt(np.sum(increments(keys) ** 2, axis=-1))
        if turns is not None:
            arcs += np.pi * np.abs(check_turns(turns, len(arcs)))
        if not np.all(arcs > 0.0):
            place = int(np.argmin(arcs))
            raise ParameterError(
                "times",
                "times='chord' must have neighbouring keyframes that differ, "
                f"got keys[{place}] and keys[{place + 1}] the same",
            )
        return np.concatenate([[0.0], np.cumsum(arcs)])
    array = check_numbers(times, "times", "'uniform', 'chord' or a list of numbers")
    if array.shape != (count,):
        raise ParameterError(
            "times",
            f"times must have one number for each of the {count} keyframes, "
            f"got an array of shape {array.shape}",
        )
    _check_finite(array, "times")
    _check_order(array, "times", array[1:] <= array[:-1], "increase strictly")
    return array


def resolve_knots(knots: object, count: int, order: int) -> Floats:
    """Return a knot vector for *count* control points of a B-spline of an order, in seconds.

    By default the knots are a second apart, and the domain begins at 0.

    Raises:
        ValueError: *knots* is not ``count + order`` finite numbers that do not decrease, the domain
            from ``knots[order - 1]`` to ``knots[count]`` is empty, or a knot inside it is
            repeated so often that the curve would jump.
    """
    if knots is None:
        return np.arange(1 - order, count + 1, dtype=np.float64)
    expected = f"a list of {count + order} non-decreasing numbers"
    vector = check_numbers(knots, "knots", expected)
    if vector.shape != (count + order,):
        raise ParameterError(
            "knots",
            f"knots must be {expected} for {count} control quaternions of order {order}, "
            f"got an array of shape {vector.shape}",
        )
    _check_finite(vector, "knots")
    _check_order(vector, "knots", vector[1:] < vector[:-1], "not decrease")
    if not vector[count] > vector[order - 1]:
        raise ParameterError(
            "knots",
            f"knots must leave a domain from knots[{order - 1}] to knots[{count}], "
            f"got {float(vector[count])!r} for both",
        )
    multiplicity = inner_multiplicity(vector, order)
    if multiplicity >= order:
        raise ParameterError(
            "knots",
            f"knots inside the domain must be repeated at most {order - 1} times for order "
            f"{order}, got one repeated {multiplicity} times",
        )
    return vector


def inner_multiplicity(vector: Floats, order: int) -> int:
    """Return the highest multiplicity of a knot strictly inside the domain, 0 without any."""
    inner = vector[(vector > vector[order - 1]) & (vector < vector[-order])]
    return int(np.unique(inner, return_counts=True)[1].max(initial=0))


def increments(keys: Floats) -> Floats:
    """Return the half-angle logarithms ``log(q_i^-1 q_{i+1})``, signs as given, ``(n - 1, 3)``."""
    return log_half(between(keys[:-1], keys[1:]))


def check_turns(turns: ArrayLike, intervals: int) -> np.ndarray[Any, np.dtype[Any]]:
    """Return whole turns, one number for each interval."""
    count = np.asarray(turns)
    if count.shape != (intervals,) or count.dtype.kind not in "iuf" or np.any(count % 1 != 0):
        raise ParameterError(
            "turns",
            f"turns must be a list of {intervals} whole numbers, one for each interval, "
            f"got {turns!r}",
        )
    return count


def with_turns(steps: Floats, keys: Floats, turns: ArrayLike) -> tuple[Floats, Floats]:
    """Return the steps with whole turns added, and the keyframes with the matching signs."""
    count = check_turns(turns, len(steps))
    lengths = np.sqrt(np.sum(steps**2, axis=-1))
    is_open = (lengths == 0.0) & (count != 0)
    if np.any(is_open):
        place = int(np.argmax(is_open))
        raise ParameterError(
            "turns",
            f"turns must be 0 between keyframes that are the same, which leave the axis open, "
            f"got turns[{place}] = {count[place]}",
        )
    longer = steps * (1.0 + count * math.pi / np.where(lengths > 0.0, lengths, 1.0))[:, None]
    signs = np.cumprod(np.concatenate([[1.0], np.where(count % 2 == 0, 1.0, -1.0)]))
    return longer, keys * signs[:, None]


def is_same(one: object, other: object) -> bool:
    """Return whether two parameters are equal; arrays and lists are compared by their entries."""
    if one is other:
        return True
    if isinstance(one, np.ndarray | list | tuple) or isinstance(other, np.ndarray | list | tuple):
        return _has_same_entries(one, other)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(is_same(one[key], other[key]) for key in one)
    if type(one) is type(other) and is_dataclass(one) and type(one).__eq__ is object.__eq__:
        names = [entry.name for entry in fields(one) if entry.compare]
        return all(is_same(getattr(one, name), getattr(other, name)) for name in names)
    return bool(one == other)


def _has_same_entries(one: Any, other: Any) -> bool:  # noqa: ANN401
    try:
        return np.array_equal(np.asarray(one), np.asarray(other), equal_nan=True)
    except (TypeError, ValueError):
        # Of different types or lengths.
        return len(one) == len(other) and all(map(is_same, one, other))
