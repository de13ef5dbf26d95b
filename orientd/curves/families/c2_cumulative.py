"""The twice differentiable cumulative cubic B-spline through keyframes: the default method."""

from __future__ import annotations

from numpy.typing import ArrayLike

from orientd.curves.construct import CumulativeCurve, interpolate
from orientd.curves.contract import takes_common_names
from orientd.curves.family import END_STATES
from orientd.curves.keyframes import (
    check_aligned,
    check_end,
    increments,
    resolve_times,
    with_turns,
)

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
    takes = ("keys", "times", *END_STATES, "align", "turns")

    @takes_common_names
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
        orientations = check_aligned(keys, align)
        ends = (
            check_end(start, "start", omega_start, alpha_start, ENDS),
            check_end(end, "end", omega_end, alpha_end, ENDS),
        )
        instants = resolve_times(times, orientations, turns)
        steps = None
        if turns is not None:
            steps, orientations = with_turns(increments(orientations), orientations, turns)
        self._set_spline(interpolate(orientations, instants, 4, ends, steps=steps))
