"""One task, every family: what keyframes, times and end velocities are to each of them.

A family says by the names of its parameters what it takes: ``keys`` with ``times``, the two ends
``q0`` and ``q1`` of one segment, or ``control`` orientations that draw the curve without meeting
it.  A new family of one of these kinds needs no line here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.curves.contract import Curve
from orientd.curves.keyframes import check_integer
from orientd.curves.retimed import Retimed
from orientd.rotation import Floats, conjugate, log, multiply

EQUAL = 1e-9
"""Of the duration, by which equal intervals may differ."""

MOST_CONTROLS = 24
"""Of one segment: its cost grows with their square, and it stays ever further away from them."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What a curve is asked to do.

    Attributes:
        keys: unit quaternions of the keyframes, shape ``(n, 4)``, *n* at least 2.
        times: increasing, s, shape ``(n,)``.
        omega_start: body angular velocity wanted at the first keyframe, rad/s; ``None`` leaves it
            to the family.
        omega_end: the same at the last keyframe.
        turns: whole turns between neighbours, shape ``(n - 1,)``; ``None`` for none.
    """

    keys: Floats
    times: Floats
    omega_start: Floats | None = None
    omega_end: Floats | None = None
    turns: NDArray[np.int64] | None = None


def parameters(
    family: type[Curve], task: Task, options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the keyword arguments with which *family* does *task*, *options* among them.

    Velocities that are wanted are given to a family that can meet them and kept from any other.
    Where none is wanted, an end is natural (without acceleration), and a single segment has the
    velocities of the great arc.

    Args:
        family: a class in ``METHODS``.
        task: what to do.
        options: further keyword arguments of the family, which go before those that follow from
            the task; knots are made for an ``order`` among them.

    Raises:
        ValueError: the family does not apply, with the reason.
    """
    names, given = set(signature(family).parameters), dict(options or {})
    if {"keys", "times"} <= names:
        return {**_through_keyframes(names, task), **given}
    if {"q0", "q1"} <= names:
        return {**_between_two(names, task), **given}
    if "control" in names:
        return {**_from_controls(names, task, given), **given}
    raise ValueError("takes neither keyframes, nor two ends, nor control orientations")


def fit(family: type[Curve], task: Task, options: Mapping[str, Any] | None = None) -> Curve:
    """Return the curve of *family* that does *task*, on the clock of the task.

    Args:
        family: a class in ``METHODS``.
        task: what to do.
        options: more keyword arguments of the family, which go before those that follow from the
            task.

    Raises:
        ValueError: the family does not apply, or cannot join these keyframes.
        PlanError: no such curve could be found.
    """
    curve = family(**parameters(family, task, options))
    start, end = float(task.times[0]), float(task.times[-1])
    return curve if curve.domain == (start, end) else Retimed(curve, start, end)


def _through_keyframes(names: set[str], task: Task) -> dict[str, Any]:
    made: dict[str, Any] = {"keys": task.keys, "times": task.times}
    if _has_turns(task):
        if "turns" not in names:
            raise ValueError("cannot make whole turns between keyframes")
        made["turns"] = task.turns
    for end, omega in (("start", task.omega_start), ("end", task.omega_end)):
        if omega is not None and f"omega_{end}" in names:
            made[f"omega_{end}"] = omega
            if end in names:
                made[end] = "clamped"
    return made


def _between_two(names: set[str], task: Task) -> dict[str, Any]:
    if len(task.keys) != 2:
        raise ValueError(f"takes exactly 2 keyframes, got {len(task.keys)}")
    start, end = float(task.times[0]), float(task.times[1])
    made: dict[str, Any] = {"q0": task.keys[0], "q1": task.keys[1], "t0": start, "t1": end}
    if _has_turns(task) and task.turns is not None:
        turns = next((name for name in ("revolutions", "spins") if name in names), None)
        if turns is None:
            raise ValueError("cannot make whole turns")
        made[turns] = int(task.turns[0])
    if "omega0" in names:
        even = log(multiply(conjugate(task.keys[0]), task.keys[1])) / (end - start)
        made["omega0"] = even if task.omega_start is None else task.omega_start
        made["omega1"] = even if task.omega_end is None else task.omega_end
    return made


def _from_controls(names: set[str], task: Task, options: Mapping[str, Any]) -> dict[str, Any]:
    if _has_turns(task):
        raise ValueError("cannot make whole turns between control orientations")
    made: dict[str, Any] = {"control": task.keys}
    if "align" in names:
        # Keyframes come with either sign.
        made["align"] = True
    if "knots" in names:
        wanted = check_integer(options.get("order", 4), "order", minimum=2)
        if wanted > len(task.keys) and "order" in options:
            raise ValueError(f"order must be at most the number of keyframes, got {wanted}")
        order = min(wanted, len(task.keys))
        made.update(order=order, knots=averaged_knots(task.times, order))
    elif "t0" in names:
        if len(task.keys) > MOST_CONTROLS:
            raise ValueError(
                f"one segment of degree {len(task.keys) - 1} is drawn through at most "
                f"{MOST_CONTROLS} control orientations"
            )
        made.update(t0=float(task.times[0]), t1=float(task.times[-1]))
    else:
        steps = np.diff(task.times)
        if np.ptp(steps) > EQUAL * (task.times[-1] - task.times[0]):
            raise ValueError(
                f"needs equal intervals between keyframes, got {steps.min():.6g} s "
                f"to {steps.max():.6g} s"
            )
    return made


def averaged_knots(times: Floats, order: int) -> Floats:
    """Return clamped knots for control orientations that belong to *times*, each their average.

    Piegl and Tiller (1997), eq. (9.8).

    >>> averaged_knots(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 4).tolist()
    [0.0, 0.0, 0.0, 0.0, 2.0, 4.0, 4.0, 4.0, 4.0]
    """
    degree = order - 1
    sums = np.concatenate([[0.0], np.cumsum(times)])
    inner = (sums[degree + 1 : len(times)] - sums[1 : len(times) - degree]) / degree
    return np.concatenate([np.full(order, times[0]), inner, np.full(order, times[-1])])


def _has_turns(task: Task) -> bool:
    return task.turns is not None and bool(np.any(task.turns))
