"""From a common task to each family: the meaning of keyframes, times and end conditions.

The parameter names of a family tell what it takes: ``keys`` with ``times``, the two ends ``q0`` and
``q1`` of one segment, or ``control`` orientations that the curve approximates.  A new family of one
of these kinds needs no change here.  All code that makes a curve of keyframes uses this module: a
constructor with the common names, a comparison, a picture, the planner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from orientd.curves.keyframes import (
    ParameterError,
    check_choice,
    check_integer,
    check_interval,
    check_keys,
    check_turns,
    check_vector,
    increments,
    resolve_knots,
    resolve_times,
)
from orientd.rotation import Floats, align, conjugate, rotate

EQUAL = 1e-9
"""Tolerance of equal intervals, as a share of the duration."""

MOST_CONTROLS = 24
"""Most control orientations of one segment, whose cost grows with their square."""

COMMON = {
    "keys": ("control", "q0", "q1"),
    "times": ("t0", "t1"),
    "start_velocity": ("omega_start", "omega0"),
    "end_velocity": ("omega_end", "omega1"),
    "velocity_frame": ("frame",),
    "turns": ("revolutions", "spins"),
}
"""Parameters that every family takes under these names, and the families' own names for them."""

_END_OF = {"omega0": 0, "alpha0": 0, "omega1": -1, "alpha1": -1}
"""Own names of vectors in the frame of the velocities, each with its keyframe."""

_FROM_TASK = frozenset(
    {
        *("keys", "times", "q0", "q1", "t0", "t1", "control", "frame", "start", "end"),
        *("omega_start", "omega_end", "omega0", "omega1", "turns", "spins"),
        *("alpha_start", "alpha_end", "alpha0", "alpha1"),
    }
)
_TURNS = ("turns", "revolutions", "spins")


class Family:
    """A class of curves, with the parameters that its constructor takes.

    Attributes:
        name: the key of the family in ``METHODS``.
        summary: one line for a list of the families.
        source: author, year and equation.
        interpolates: whether the curve passes through every keyframe at its time.
        local: whether moving a keyframe changes the curve near that keyframe only.
        meets_end_velocities: whether angular velocities can be set at both ends.
        meets_end_accelerations: whether accelerations can be set too.
        takes: the family's own names of its parameters, in order.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]
    interpolates: ClassVar[bool] = False
    local: ClassVar[bool] = False
    meets_end_velocities: ClassVar[bool] = False
    meets_end_accelerations: ClassVar[bool] = False
    takes: ClassVar[tuple[str, ...]] = ()


Made = TypeVar("Made", bound=Family)


class UnevenError(ParameterError):
    """Keyframes at unequal intervals, for a family that needs equal ones.

    Attributes:
        keyframe: index of the end of the first interval that differs.
    """

    def __init__(self, steps: Floats) -> None:
        super().__init__(
            "times",
            f"needs equal intervals between keyframes, got {steps.min():.6g} s "
            f"to {steps.max():.6g} s",
        )
        self.keyframe = int(np.argmax(np.abs(steps - steps[0]))) + 1


@dataclass(frozen=True, slots=True, eq=False)
class CurveTask:
    """The task of a curve.

    Attributes:
        keys: unit quaternions of the keyframes, shape ``(n, 4)``, *n* at least 2.
        times: increasing, s, shape ``(n,)``.
        omega_start: body angular velocity at the first keyframe, rad/s; ``None`` leaves it to the
            family.
        omega_end: body angular velocity at the last keyframe, in the same way.
        turns: whole turns between neighbours, shape ``(n - 1,)``; ``None`` for none.
        alpha_start: body angular acceleration for *omega_start*, rad/s^2.
        holds: whether a device holds before and after.  An end without a velocity is then at rest,
            if the family can set it.  It has no acceleration either, if the family can set both.
        leaves_freely: whether an end at rest may still have an acceleration, because the pace along
            the curve is found afterwards, from rest.  A family that cannot set accelerations then
            keeps its natural end.
        is_timed: whether the keyframes have these times.  Otherwise the times are chord lengths,
            and control orientations are spread evenly over the same duration.
    """

    keys: Floats
    times: Floats
    omega_start: Floats | None = None
    omega_end: Floats | None = None
    turns: NDArray[np.int64] | None = None
    alpha_start: Floats | None = None
    holds: bool = False
    leaves_freely: bool = False
    is_timed: bool = True

    @property
    def wanted(self) -> tuple[Floats | None, Floats | None]:
        """The velocities at both ends, given or implied; ``None`` if they are free."""
        rest = np.zeros(3) if self.holds else None
        return (
            rest if self.omega_start is None else self.omega_start,
            rest if self.omega_end is None else self.omega_end,
        )


def options_of(family: type[Family]) -> tuple[str, ...]:
    """Return the parameters of a family that do not follow from a task."""
    return tuple(name for name in family.takes if name not in _FROM_TASK)


def is_pair(family: type[Family]) -> bool:
    """Return whether a family joins exactly two keyframes."""
    return "q0" in family.takes


def turns_name(family: type[Family]) -> str | None:
    """Return the parameter for whole turns of a family; ``None`` if it has none."""
    return next((name for name in _TURNS if name in family.takes), None)


def parameters(
    family: type[Family], task: CurveTask, options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the keyword arguments for *family* to fulfil *task*, including *options*.

    Only a family that can meet velocities gets them.  Without a velocity, an end is natural
    (without acceleration), and a single segment has the velocities of the great arc.  If a device
    holds, see :attr:`CurveTask.holds`.

    Args:
        family: a class in ``METHODS``.
        task: the task of the curve.
        options: further keyword arguments of the family, which override those of the task.  An
            ``order`` among them sets the knots, and knots are scaled to the clock of the task.

    Raises:
        UnevenError: the family needs equal intervals.
        ValueError: the family does not apply, with the reason.
    """
    given = dict(options or {})
    if is_pair(family):
        made = _between_two(family, task)
    elif "keys" in family.takes:
        made = _through_keyframes(family, task)
    else:
        made = _from_controls(family, task, given)
    if task.turns is not None and np.any(task.turns):
        turned = turns_name(family)
        if turned is None:
            raise ValueError("cannot make whole turns between keyframes")
        made[turned] = int(task.turns[0]) if is_pair(family) else task.turns
    return {**made, **given}


def make_curve(
    family: type[Made], task: CurveTask, options: Mapping[str, Any] | None = None
) -> Made:
    """Return the curve of *family* for *task*, on the clock of the task.

    Args:
        family: a class in ``METHODS``.
        task: the task of the curve.
        options: further keyword arguments of the family, which override those of the task.

    Raises:
        ValueError: the family does not apply, or has no curve through these keyframes.
        PlanError: the search found no curve.
    """
    return family(**parameters(family, task, options))


def own_names(family: type[Family], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters by a family's own names, if some have common names.

    Args:
        family: a class in ``METHODS``.
        given: ``keys``, ``times`` (as in :func:`resolve_times`), ``start_velocity`` and
            ``end_velocity`` in ``velocity_frame`` (``"body"`` or ``"world"``), ``turns`` (one
            number for each interval, or one for a single interval), and further parameters of the
            family.

    Raises:
        ValueError: the family cannot do it, or a parameter has a wrong value.
        TypeError: there is no keyframe, or a parameter is given by two names.
    """
    rest = dict(given)
    common = {name: rest.pop(name, None) for name in COMMON}
    for name, others in COMMON.items():
        twice = [other for other in others if other in rest and common[name] is not None]
        if twice:
            raise TypeError(f"{family.name} must be given {name} or {twice[0]}, got both")
    keys = _keys_of(family, common["keys"], rest)
    turns = common["turns"]
    if turns is not None:
        turns = check_turns(np.atleast_1d(np.asarray(turns)), len(keys) - 1)
    times, is_timed = common["times"], common["times"] is not None
    if times is None and {"t0", "t1"} & rest.keys():
        times, is_timed = check_interval(rest.pop("t0", 0.0), rest.pop("t1", 1.0)), True
        times = np.linspace(*times, len(keys))
    frame = common["velocity_frame"] or rest.pop("frame", "body")
    is_world = check_choice(frame, "velocity_frame", ("body", "world")) == "world"
    for name in _END_OF.keys() & rest.keys() if is_world else ():
        vector = check_vector(rest[name], name)
        rest[name] = rotate(conjugate(keys[_END_OF[name]]), vector)

    def in_body_frame(name: str, key: Floats) -> Floats | None:
        if common[name] is None:
            return None
        if not family.meets_end_velocities:
            raise ParameterError(
                name, f"{name} must be None: {family.name} cannot prescribe velocities"
            )
        omega = check_vector(common[name], name)
        return rotate(conjugate(key), omega) if is_world else omega

    aligned = align(keys) if rest.get("align", True) else keys
    task = CurveTask(
        keys,
        resolve_times(times, aligned, turns),
        in_body_frame("start_velocity", keys[0]),
        in_body_frame("end_velocity", keys[-1]),
        turns,
        is_timed=is_timed,
    )
    return parameters(family, task, rest)


def _keys_of(family: type[Family], keys: Any, rest: dict[str, Any]) -> Floats:  # noqa: ANN401
    """Return the keyframes under any of their names, and remove them from *rest*."""
    if keys is not None:
        return check_keys(keys)
    if "control" in rest:
        return check_keys(rest.pop("control"), "control")
    if {"q0", "q1"} <= rest.keys():
        return check_keys([rest.pop("q0"), rest.pop("q1")], "q0 and q1")
    raise TypeError(f"{family.name} must be given keys, got {', '.join(rest) or 'none'}")


def _through_keyframes(family: type[Family], task: CurveTask) -> dict[str, Any]:
    made: dict[str, Any] = {"keys": task.keys, "times": task.times}
    for end, omega, alpha in (
        ("start", task.omega_start, task.alpha_start),
        ("end", task.omega_end, None),
    ):
        has_conditions = end in family.takes
        if f"omega_{end}" not in family.takes:
            continue
        is_natural = has_conditions and task.leaves_freely and not family.meets_end_accelerations
        if omega is None and task.holds and not is_natural:
            omega = np.zeros(3)
        if omega is None:
            continue
        made[f"omega_{end}"] = omega
        if not has_conditions:
            continue
        if alpha is None and task.holds and not np.any(omega) and not task.leaves_freely:
            # From rest a motion begins without a step in torque.  With a velocity, the previous
            # motion supplies the acceleration.
            alpha = np.zeros(3)
        made[end] = "clamped"
        if alpha is not None and family.meets_end_accelerations:
            made[end], made[f"alpha_{end}"] = "state", alpha
    return made


def _between_two(family: type[Family], task: CurveTask) -> dict[str, Any]:
    if len(task.keys) != 2:
        raise ValueError(f"takes exactly 2 keyframes, got {len(task.keys)}")
    start, end = float(task.times[0]), float(task.times[1])
    made: dict[str, Any] = {"q0": task.keys[0], "q1": task.keys[1], "t0": start, "t1": end}
    if "omega0" in family.takes:
        even = 2.0 * increments(align(task.keys))[0] / (end - start)
        for name, omega in zip(("omega0", "omega1"), task.wanted, strict=True):
            made[name] = even if omega is None else omega
    if "alpha0" in family.takes and task.alpha_start is not None:
        made["alpha0"] = task.alpha_start
    return made


def _from_controls(
    family: type[Family], task: CurveTask, options: dict[str, Any]
) -> dict[str, Any]:
    # Keyframes may have either sign.
    made: dict[str, Any] = {"control": task.keys, "align": True}
    start, end = float(task.times[0]), float(task.times[-1])
    count = len(task.keys)
    times = task.times if task.is_timed else np.linspace(start, end, count)
    if "knots" in family.takes:
        wanted = check_integer(options.get("order", 4), "order", minimum=2)
        if wanted > count and "order" in options:
            raise ParameterError(
                "order", f"order must be at most the number of keyframes, {count}, got {wanted}"
            )
        order = made["order"] = min(wanted, count)
        knots = options.pop("knots", None)
        made["knots"] = (
            averaged_knots(times, order) if knots is None else _on_the_clock(knots, times, order)
        )
        return made
    if family.local:
        steps = np.diff(times)
        if np.ptp(steps) > EQUAL * (end - start):
            raise UnevenError(steps)
    elif count > MOST_CONTROLS:
        raise ValueError(
            f"one segment of degree {count - 1} is drawn through at most "
            f"{MOST_CONTROLS} control orientations"
        )
    return {**made, "t0": start, "t1": end}


def _on_the_clock(knots: Any, times: Floats, order: int) -> Floats:  # noqa: ANN401
    """Return knots in any unit, scaled so that their curve is as long as *times*."""
    vector = resolve_knots(knots, len(times), order)
    begin, end = vector[order - 1], vector[-order]
    mapped: Floats = times[0] + (vector - begin) * ((times[-1] - times[0]) / (end - begin))
    mapped[order - 1], mapped[-order] = times[0], times[-1]
    # Rounding must not move a repeated knot to either side of an end.
    return np.maximum.accumulate(np.where(vector >= end, np.maximum(mapped, times[-1]), mapped))


def averaged_knots(times: Floats, order: int) -> Floats:
    """Return clamped knots for control orientations at *times*, by averages of these.

    Piegl and Tiller (1997), eq. (9.8).

    >>> averaged_knots(np.array([0.0, 1.0, 2.0, 3.0, 4.0]), 4).tolist()
    [0.0, 0.0, 0.0, 0.0, 2.0, 4.0, 4.0, 4.0, 4.0]
    """
    degree = order - 1
    sums = np.concatenate([[0.0], np.cumsum(times)])
    inner = (sums[degree + 1 : len(times)] - sums[1 : len(times) - degree]) / degree
    return np.concatenate([np.full(order, times[0]), inner, np.full(order, times[-1])])
