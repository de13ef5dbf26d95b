"""The cumulative B-spline of any order from 3 to 6 through keyframes: up to C4."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    CumulativeCurve,
    Spline,
    cumulative_basis,
    interpolate,
    squared_acceleration,
    unwound,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.family import END_STATES
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_end,
    check_integer,
    check_vector,
    increments,
    resolve_times,
    with_turns,
)
from orientd.rotation import Floats


class KksInterpolating(CumulativeCurve):
    r"""Pass through keyframes with a cumulative B-spline of order *k*, continuous to order k - 2.

    .. math:: q(t) = q_0 \prod_i \exp\bigl(w_i \tilde B_{i,k}(t)\bigr)

    Kim, Kim and Shin (1995), sec. 5.3, whose curve approximates its control quaternions; here the
    increments *w* are solved for.  Order 4 is ``c2_cumulative``; order 6 also has continuous jerk
    and its rate, which is what stiff drives and cameras ask for.  The knots are the keyframes'
    times for even orders and the middles between them for odd ones, with ends repeated *k* times,
    so that both ends need the same number of conditions, *c* = 1 for orders 3 and 4, 2 for 5
    and 6:

    * ``"natural"``: no acceleration; with *c* = 2 no jerk either;
    * ``"clamped"``: the angular velocity given; with *c* = 2 the angular acceleration too.

    At a clamped end only the first function has a slope, the first two a curvature, so with all
    values taken at the first instant :math:`2 \tilde B_1' w_1 = \Omega`,
    :math:`2 (\tilde B_1'' w_1 + \tilde B_2'' w_2) = \dot\Omega`; without acceleration the
    first increments are parallel, and the jerk is :math:`2 \sum_{i \le 3} \tilde B_i''' w_i`.

    Moving a keyframe changes the curve everywhere, by an amount that decays with distance; building
    takes time in proportion to the number of keyframes.

    Picture: ``orientd plot kks_interpolating``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        order: degree plus one, 3 to 6.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
        omega_start: body angular velocity at the first keyframe, rad/s, if clamped.
        omega_end: body angular velocity at the last keyframe, rad/s, if clamped.
        alpha_start: body angular acceleration there, rad/s^2, if clamped with orders 5 and 6;
            zero without it.
        alpha_end: body angular acceleration at the last keyframe.
        align: whether each keyframe takes the sign nearer to its predecessor.
        turns: whole turns to add between each keyframe and the next, about the axis of the turn
            that joins them; a fast end coasts through some.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: no such curve could be found, as may happen for ends of more than 20 rad/s over
            intervals of 1 s unless *turns* takes up their speed.
    """

    name = "kks_interpolating"
    summary = "cumulative B-spline of order 3 to 6 through keyframes, up to C4"
    source = "Kim, Kim and Shin 1995, sec. 5.3, made to interpolate"
    interpolates = True
    meets_end_velocities = True
    takes = ("keys", "times", "order", *END_STATES, "align", "turns")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        order: int = 6,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        alpha_start: ArrayLike | None = None,
        alpha_end: ArrayLike | None = None,
        align: bool = True,
        turns: ArrayLike | None = None,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q, turns)
        steps = None
        if turns is not None:
            steps, q = with_turns(increments(q), q, turns)
        k = check_integer(order, "order", minimum=3)
        if k > 6:
            raise ParameterError("order", f"order must be 3, 4, 5 or 6, got {order!r}")
        ends = (
            check_end_state(start, omega_start, alpha_start, "start", k),
            check_end_state(end, omega_end, alpha_end, "end", k),
        )
        solved = interpolate(q, instants, k, ends, steps=steps)
        others = unwound(q, instants, k, ends, solved.increments) if turns is None else []

        def parts(spline: Spline) -> dict[str, Any]:
            first, *inner, last = spline.breaks
            basis = cumulative_basis(np.array([first] * k + inner + [last] * k), k)
            return {
                "basis": basis,
                "controls": spline.base,
                "increments": spline.increments,
                "continuity": k - 2,
            }

        def effort(spline: Spline) -> float:
            return squared_acceleration(CumulativeCurve(**parts(spline)).evaluate, spline.breaks)

        if others:
            solved = min([solved, *others], key=effort)
        super().__init__(**parts(solved))
        self._key_times = instants

    @property
    def key_times(self) -> Floats:
        """The instants of the keyframes, which for odd orders are not the knots, ``(n,)``."""
        times: Floats = self._key_times.copy()
        return times


def check_end_state(
    condition: object, omega: ArrayLike | None, alpha: ArrayLike | None, side: str, order: int
) -> tuple[Floats | None, Floats | None]:
    """Return velocity and, for orders 5 and 6, acceleration at one end.

    Raises:
        ValueError: the condition is not one, or what is given does not go with it.
    """
    velocity, _ = check_end(condition, side, omega)
    if alpha is not None and (velocity is None or order < 5):
        if velocity is None:
            raise ParameterError(
                f"alpha_{side}",
                f"alpha_{side} must be None with {side}='natural', got {alpha!r}; "
                f"use {side}='clamped'",
            )
        raise ParameterError(
            f"alpha_{side}", f"alpha_{side} must be None for order {order}, got {alpha!r}"
        )
    if velocity is None or order < 5:
        return velocity, None
    return velocity, np.zeros(3) if alpha is None else check_vector(alpha, f"alpha_{side}")
