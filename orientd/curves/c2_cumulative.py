"""The twice differentiable cumulative cubic B-spline through keyframes: the default method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves import fast
from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.continuation import solve
from orientd.curves.cumulative import CumulativeCurve
from orientd.curves.interpolation import EndCondition, KeyframeEquations
from orientd.curves.keyframes import (
    check_bool,
    check_choice,
    check_keys,
    check_vector,
    increments,
    resolve_times,
    with_turns,
)
from orientd.curves.product import TABLE_ROWS
from orientd.rotation import Floats, exp_half, multiply, rotate
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
        times: instants in seconds, ``"uniform"`` or ``"chord"``.
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

    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike = "chord",
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
        if turns is None and not isinstance(times, str):
            instants = resolve_times(times, orientations)
            if self._interpolated(orientations, instants, ends, is_aligned=not align):
                return
        if align:
            orientations = align_signs(orientations)
        instants = resolve_times(times, orientations)
        steps = increments(orientations)
        if turns is not None:
            steps, orientations = with_turns(steps, orientations, turns)
        vector, places = _knots(instants, *(end.count == 2 for end in ends))
        basis = cumulative_basis(vector, 4)
        equations = KeyframeEquations(
            *_factors(basis, places),
            steps=steps,
            start=_start_condition(basis, ends[0]),
            end=_end_condition(basis, ends[1]),
        )
        solved = solve(equations)
        super().__init__(
            basis=basis,
            controls=_controls(basis, places, orientations, solved),
            increments=solved,
            continuity=2,
        )

    @classmethod
    def of_table(
        cls, breaks: Floats, table: Floats, solved: Floats, at_ends: Floats
    ) -> C2Cumulative:
        """Return the spline that a compiled kernel has found.

        Args:
            breaks: where its spans begin and end, s, shape ``(S + 1,)``.
            table: what it is sampled from, shape ``(25, S)``.
            solved: its increments, shape ``(S + 2, 3)``.
            at_ends: samples at both ends, shape ``(10, 2)``.
        """
        spline = cls.__new__(cls)
        spline._set_table(breaks, table, solved, 2)  # noqa: SLF001 - its own class
        spline._set_ends(at_ends)  # noqa: SLF001 - likewise
        return spline

    def _interpolated(
        self, keys: Floats, times: Floats, ends: tuple[_End, _End], *, is_aligned: bool
    ) -> bool:
        """Set up the spline as the compiled kernel finds it; return whether that was possible."""
        interpolate = fast.KERNEL.interpolate
        start, end = (each.count for each in ends)
        if interpolate is None or (len(keys) == 2 and start == end == 2):
            return False
        spans = len(keys) - 1 + (start == 2) + (end == 2)
        breaks, table = np.empty(spans + 1), np.empty((TABLE_ROWS, spans))
        solved: Floats = np.empty((spans + 2, 3))
        given = np.stack([each.given for each in ends])
        keys, times = np.ascontiguousarray(keys), np.ascontiguousarray(times)
        is_found = interpolate(keys, is_aligned, times, given, start, end, breaks, table, solved)
        if is_found:
            self._set_table(breaks, table, solved, 2)
        return is_found


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


def _knots(times: Floats, with_start: bool, with_end: bool) -> tuple[Floats, Indices]:
    """Return the knot vector, and which of its spans begins at each keyframe.

    The last keyframe, at which none begins, gets the number of spans.
    """
    first, last = times[:2], times[-2:]
    extra: list[float] = []
    if len(times) == 2 and with_start and with_end:
        extra = [float(first[0] + share * (first[1] - first[0])) for share in (1 / 3, 2 / 3)]
    else:
        extra += [float(0.5 * (first[0] + first[1]))] if with_start else []
        extra += [float(0.5 * (last[0] + last[1]))] if with_end else []
    breaks = np.sort(np.concatenate([times, extra]))
    vector = np.concatenate([np.repeat(breaks[0], 3), breaks, np.repeat(breaks[-1], 3)])
    return vector, np.searchsorted(breaks, times)


def _factors(basis: CumulativeBasis, places: Indices) -> tuple[Indices, Floats]:
    """Return increments and shares of the factors that lead from each keyframe to the next.

    On the way from span *s* to span *s'*, the partial factors *s* and *s+1* at the first keyframe
    are undone from the right, those up to *s'-1* are completed, and *s'* and *s'+1* begun.
    """
    here, there = places[:-1], places[1:]
    begun: Floats = np.ones((len(basis.first) + 1, 2))
    begun[:-1] = basis.values[:, :2, 0]
    passed = int(np.max(there - here))
    index = [here + 1, here]
    share = [-begun[here, 1], 1.0 - begun[here, 0]]
    for more in range(1, passed):
        is_passed = here + more < there
        index.append(np.where(is_passed, here + more, here))
        share.append(np.where(is_passed, 1.0, 0.0))
    index += [there, there + 1]
    share += [begun[there, 0], begun[there, 1]]
    return np.stack(index, axis=1), np.stack(share, axis=1)


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


def _start_condition(basis: CumulativeBasis, end: _End) -> EndCondition:
    return _condition(end, basis.rates[0, 0, 0], *basis.curvatures[0, :2, 0])


def _end_condition(basis: CumulativeBasis, end: _End) -> EndCondition:
    """The turn of the last factor stands between the acceleration and the factor before it."""
    rate = basis.rates[-1, 2, -1]
    turned = rotate(exp_half(end.given[0] / (2.0 * rate)), end.given[1])
    turned_end = _End(end.count, np.stack([end.given[0], turned]))
    return _condition(turned_end, rate, *basis.curvatures[-1, [2, 1], -1])


def _condition(end: _End, rate: float, first: float, second: float) -> EndCondition:
    if end.count == 0:
        return EndCondition(known=np.empty((0, 3)), ratio=float(-second / first))
    outer = end.given[0] / (2.0 * rate)
    inner = (0.5 * end.given[1] - first * outer) / second
    return EndCondition(known=np.stack([outer, inner])[: end.count])


def _controls(basis: CumulativeBasis, places: Indices, keys: Floats, solved: Floats) -> Floats:
    """Return the control quaternion before the product of each span.

    Each is reached from the keyframe its span begins at, so that no error accumulates along the
    curve; a span that begins between keyframes continues the one before it.
    """
    count = len(basis.first)
    begun = basis.values[:, :2, 0]
    controls: Floats = np.empty((count, 4))
    spans = places[:-1]
    turns = np.stack([solved[spans], solved[spans + 1]])
    first, second = exp_half(-begun[spans].T[..., None] * turns)
    controls[spans] = multiply(keys[:-1], multiply(second, first))
    is_between = np.ones(count, dtype=np.bool_)
    is_between[spans] = False
    for span in np.flatnonzero(is_between).tolist():
        controls[span] = multiply(controls[span - 1], exp_half(solved[span - 1]))
    return controls
