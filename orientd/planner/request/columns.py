"""Columns of a request's keyframes: checked, and as arrays, errors named by keyframe and field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.errors import RequestError
from orientd.rotation import ROUNDING, Floats, check_unit
from orientd.tolerances import NORM_TOLERANCE, TYPED_NORM_TOLERANCE

MOST_TURNS = 1000
MOST_NOTES = 20
LONGEST_NOTE = 300
"""Characters."""
FARTHEST = 1e12
"""m from the origin, in every direction; squares of what is further away end in overflow."""

Vector3 = tuple[float, float, float]
"""``(x, y, z)``; its frame and unit are in the name of what holds it."""
Turns = np.ndarray[Any, np.dtype[np.int64]]


def vector(components: ArrayLike, name: str) -> Vector3:
    """Return three finite numbers, of the field *name*."""
    try:
        array = np.asarray(components, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (3,):
        raise RequestError(name, f"expected three numbers, got {components!r}")
    if not np.all(np.isfinite(array)):
        raise RequestError(name, f"expected finite numbers, got {array.tolist()}")
    x, y, z = array.tolist()
    return x, y, z


def orientations(given: Sequence[Any]) -> tuple[Floats, list[int]]:
    """Return unit quaternions, shape (n, 4), and where they were off by more than rounding."""
    keys = _table(given, 4, "quaternion", "four numbers w, x, y, z")
    with np.errstate(over="ignore"):
        norm = np.sqrt(np.sum(keys * keys, axis=-1))
    error = np.abs(norm - 1.0)
    largest = float(error.max())
    if largest > TYPED_NORM_TOLERANCE:
        index = int(np.argmax(error > TYPED_NORM_TOLERANCE))
        raise RequestError(
            f"keyframes[{index}].quaternion",
            f"norm must be 1 within {TYPED_NORM_TOLERANCE:g}, got {norm[index]:.9g}",
        )
    typed = np.flatnonzero(error > NORM_TOLERANCE)
    keys[typed] /= norm[typed, None]
    # What is unit to rounding stays as it is; that is the rule of check_unit.
    return keys if largest <= ROUNDING else check_unit(keys), typed.tolist()


def notes(given: Sequence[Any]) -> tuple[str, ...]:
    """Return lines for the certificate, checked."""
    if isinstance(given, str) or len(given) > MOST_NOTES:
        raise RequestError("notes", f"expected at most {MOST_NOTES} lines")
    for index, line in enumerate(given):
        if not (isinstance(line, str) and len(line) <= LONGEST_NOTE and line.isprintable()):
            expected = f"expected at most {LONGEST_NOTE} printable characters"
            raise RequestError(f"notes[{index}]", f"{expected}, got {str(line)[:20]!r}")
    return tuple(given)


def _table(rows: Sequence[Any], width: int, name: str, expected: str) -> Floats:
    """Return *rows* as an array, naming the first one that is not *width* finite numbers."""
    try:
        table = np.asarray(rows, dtype=np.float64)
        is_regular = table.shape == (len(rows), width)
    except (TypeError, ValueError):
        is_regular = False
    if not is_regular:
        for index, row in enumerate(rows):
            try:
                fits = np.asarray(row, dtype=np.float64).shape == (width,)
            except (TypeError, ValueError):
                fits = False
            if not fits:
                raise RequestError(f"keyframes[{index}].{name}", f"expected {expected}, got {row}")
    is_finite = np.isfinite(table)
    if not is_finite.all():
        bad = ~np.all(is_finite, axis=-1)
        index = int(np.argmax(bad))
        raise RequestError(
            f"keyframes[{index}].{name}", f"expected finite numbers, got {table[index].tolist()}"
        )
    return table


def times(given: Sequence[Any]) -> Floats | None:
    """Return times that increase, s, shape (n,); ``None`` where no keyframe has one."""
    if given.count(None) == len(given):
        return None
    if None in given:
        index = given.index(None) if given[0] is not None else 0
        other = next(i for i, time in enumerate(given) if time is not None)
        raise RequestError(
            f"keyframes[{index}].time",
            f"missing: keyframes[{other}] has one, so every keyframe needs one (or none)",
        )
    seconds = _table([(time,) for time in given], 1, "time", "a number of seconds")[:, 0]
    steps = np.diff(seconds)
    if np.any(steps <= 0.0):
        index = int(np.argmax(steps <= 0.0)) + 1
        now, before = seconds[index], seconds[index - 1]
        raise RequestError(
            f"keyframes[{index}].time",
            f"{now:.9g} s is the time of keyframes[{index - 1}] too: an interval of length zero"
            if now == before
            else f"must be later than keyframes[{index - 1}] at {before:.9g} s, got {now:.9g} s",
        )
    return seconds


def positions(given: Sequence[Any]) -> Floats | None:
    """Return positions, m, shape (n, 3), NaN where a keyframe has none; ``None`` without any."""
    if all(position is None for position in given):
        return None
    places = np.full((len(given), 3), math.nan)
    for index, position in enumerate(given):
        if position is None:
            continue
        name = f"keyframes[{index}].position"
        places[index] = vector(position, name)
        farthest = float(np.max(np.abs(places[index])))
        if farthest > FARTHEST:
            raise RequestError(name, f"expected at most {FARTHEST:g} m, got {farthest:g} m")
    return places


def turns(given: Sequence[Any]) -> Turns:
    """Return whole turns beyond the short way, shape (n,)."""
    if given.count(0) == len(given) and set(map(type, given)) == {int}:
        return np.zeros(len(given), dtype=np.int64)
    for index, count in enumerate(given):
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)):
            raise RequestError(f"keyframes[{index}].turns", f"expected whole turns, got {count!r}")
        if abs(int(count)) > MOST_TURNS:
            raise RequestError(
                f"keyframes[{index}].turns", f"expected at most {MOST_TURNS} turns, got {count}"
            )
    if given[0] and len(given) > 1:
        raise RequestError(
            "keyframes[0].turns", f"there is no keyframe before the first, got {given[0]} turns"
        )
    return np.array(given, dtype=np.int64)
