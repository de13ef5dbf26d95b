"""The twice differentiable cumulative cubic B-spline through keyframes: the default method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    TABLE_ROWS,
    CumulativeCurve,
    EndCondition,
    KeyframeEquations,
    solve,
)
from orientd.curves.keyframes import (
    check_bool,
    check_choice,
    check_keys,
    check_vector,
    increments,
    resolve_times,
    with_turns,
)
from orientd.kernels import interpolate_c2, put_equations, put_table
from orientd.rotation import Floats
from orientd.rotation import align as align_signs

ENDS = ("natural", "clamped", "state")


class C2Cumulative(CumulativeCurve):
    r"""Pass through keyframes at their times with continuous velocity and acceleration.

    .. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_{j,4}(t)\bigr)

    The cumulative cubic B-spline of Kim, Kim and Shin (1995), sec. 5.3, over the keyframes' times
    as simple knots and fourfold end knots.  Their paper approximates its control quaternions; here
    the increments are solved for so that the curve meets every keyframe (compare their paper at
    Computer Animation '95, which does so for unit-spaced keyframes).  With :math:`w_1` the first
    increment and :math:`\tilde B` taken at the first instant:

    * ``"natural"``: no acceleration, :math:`\tilde B_1'' w_1 + \tilde B_2'' w_2 = 0`;
    * ``"clamped"``: the angular velocity given, :math:`2 \tilde B_1' w_1 = \Omega`;
    * ``"state"``: angular velocity and acceleration both given.  The one unknown that takes comes
      from one more knot in the middle of the end interval (an extension of the paper; with two
      keyframes and both ends so, the knots divide the interval in three).

    The conditions at the end are the same, seen from there.  Moving a keyframe changes the curve
    everywhere, by an amount that decays quickly with distance.

    Picture: ``orientd plot c2_cumulative``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
        omega_start: body angular velocity at the first keyframe, rad/s.
        omega_end: body angular velocity at the last keyframe, rad/s.
        alpha_start: body angular acceleration at the first keyframe, rad/s^2.
        alpha_end: body angular acceleration at the last keyframe, rad/s^2.
        align: whether each keyframe takes the sign nearer to its predecessor.
        turns: whole turns to add between each keyframe and the next, about the axis of the turn
            that joins them.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: no such curve could be found; it does not happen for steps below 178 degrees
            with moderate end velocities.
    """

    name = "c2_cumulative"
    summary = "C2 interpolation, end velocities met; the default"
    source = "Kim, Kim and Shin 1995, sec. 5.3, made to interpolate"
    interpolates = True
    meets_end_velocities = True
    meets_end_accelerations = True

    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        alpha_start: ArrayLike | None = None,
        alpha_end: ArrayLike | None = None,
        align: bool = True,
        turns: ArrayLike | None = None,
    ) -> None:
        orientations, align = check_keys(keys), check_bool(align, "align")
        ends = (
            _End.of("start", check_choice(start, "start", ENDS), omega_start, alpha_start),
            _End.of("end", check_choice(end, "end", ENDS), omega_end, alpha_end),
        )
        if align and (turns is not None or times is None or isinstance(times, str)):
            orientations = align_signs(orientations)
        instants = resolve_times(times, orientations, turns)
        spans = len(orientations) - 1 + sum(end.count == 2 for end in ends)
        breaks, table = np.empty(spans + 1), np.empty((TABLE_ROWS, spans))
        solved: Floats = np.empty((spans + 2, 3))
        given = np.array([end.given for end in ends])
        start_known, end_known = (end.count for end in ends)
        unknown = solved[max(1, start_known) :][: len(orientations) - 1]
        found = 0
        if turns is None:
            found = interpolate_c2(
                *(orientations, not align, instants, given, start_known, end_known),
                *(breaks, table, solved),
            )
        if found < len(unknown):
            if align:
                orientations = align_signs(orientations)
            steps = increments(orientations)
            if turns is not None:
                steps, orientations = with_turns(steps, orientations, turns)
            solved = solve(_equations(steps, instants, ends, breaks), unknown, found)
            put_table(orientations, start_known == 2, breaks, solved, table)
        self._set_table(breaks, table, solved, 2)


@dataclass(frozen=True, slots=True)
class _End:
    """What is prescribed at an end.

    Attributes:
        count: how much of what is given: nothing, the velocity, or the acceleration, too.
        given: body angular velocity and acceleration, shape ``(2, 3)``.
    """

    count: int
    given: Floats

    @classmethod
    def of(
        cls, side: str, condition: str, omega: ArrayLike | None, alpha: ArrayLike | None
    ) -> _End:
        given: Floats = np.zeros((2, 3))
        count = 0
        for vector in check_given(condition, side, omega, alpha):
            if vector is not None:
                given[count] = vector
                count += 1
        return cls(count, given)


def _equations(
    steps: Floats, times: Floats, ends: tuple[_End, _End], breaks: Floats
) -> KeyframeEquations:
    """Return the equations, and write the ends of the spans."""
    given = np.stack([end.given for end in ends])
    counts = ends[0].count, ends[1].count
    begun, known, ratios = np.empty((len(times), 2)), np.empty((2, 2, 3)), np.empty(2)
    put_equations(times, given, *counts, breaks, begun, known, ratios)
    start, end = (
        EndCondition(vectors[:count], float(ratio))
        for vectors, count, ratio in zip(known, counts, ratios, strict=True)
    )
    return KeyframeEquations(steps, begun, start, end)


def check_given(
    condition: str, side: str, omega: ArrayLike | None, alpha: ArrayLike | None
) -> tuple[Floats | None, Floats | None]:
    """Return the checked end velocity and acceleration, refusing what the condition lacks."""
    if condition != "natural" and omega is None:
        raise ValueError(f"omega_{side} must be given for {side}={condition!r}, got None")
    if condition == "state" and alpha is None:
        raise ValueError(f"alpha_{side} must be given for {side}='state', got None")
    if condition != "state" and alpha is not None:
        raise ValueError(
            f"alpha_{side} must be None unless {side}='state', got {alpha!r} with {condition!r}"
        )
    if condition == "natural" and omega is not None:
        raise ValueError(
            f"omega_{side} must be None with {side}='natural', got {omega!r}; use {side}='clamped'"
        )
    return (
        None if omega is None else check_vector(omega, f"omega_{side}"),
        None if alpha is None else check_vector(alpha, f"alpha_{side}"),
    )
