"""The cumulative B-spline of any order from 3 to 6 through keyframes: up to C4."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.cumulative import CumulativeCurve
from orientd.curves.keyframes import (
    check_aligned,
    check_choice,
    check_integer,
    check_vector,
    increments,
    resolve_times,
)
from orientd.curves.telescoped import TelescopedEquations
from orientd.rotation import Floats, exp_half, multiply, rotate

ENDS = ("natural", "clamped")


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

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"`` or ``"chord"``.
        order: degree plus one, 3 to 6.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
        omega_start: body angular velocity at the first keyframe, rad/s, if clamped.
        omega_end: body angular velocity at the last keyframe, rad/s, if clamped.
        alpha_start: body angular acceleration there, rad/s^2, if clamped with orders 5 and 6;
            zero without it.
        alpha_end: body angular acceleration at the last keyframe.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: no such curve could be found.
    """

    name = "kks_interpolating"
    summary = "cumulative B-spline of order 3 to 6 through keyframes, up to C4"
    source = "Kim, Kim and Shin 1995, sec. 5.3, made to interpolate"
    interpolates = True
    meets_end_velocities = True

    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike = "uniform",
        order: int = 6,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        alpha_start: ArrayLike | None = None,
        alpha_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        k = check_integer(order, "order", minimum=3)
        if k > 6:
            raise ValueError(f"order must be 3, 4, 5 or 6, got {order!r}")
        first = check_end_state(start, omega_start, alpha_start, "start", k)
        last = check_end_state(end, omega_end, alpha_end, "end", k)
        middles = 0.5 * (instants[1:] + instants[:-1])
        inner = instants[1:-1] if k % 2 == 0 else middles
        knots = np.concatenate([np.repeat(instants[0], k), inner, np.repeat(instants[-1], k)])
        basis = cumulative_basis(knots, k)
        shares = begun_shares(basis, instants)
        head, head_known = end_rows(basis, first, is_end=False)
        tail, tail_known = end_rows(basis, last, is_end=True)
        solved = TelescopedEquations(
            shares=shares,
            steps=increments(q),
            head=head,
            head_known=head_known,
            tail=tail,
            tail_known=tail_known,
        ).solve()
        spans = np.arange(len(basis.values))
        controls = q[spans]
        for f in reversed(range(shares.shape[1])):
            back = -shares[spans, f, None] * solved[spans + f]
            controls = multiply(controls, exp_half(back))
        super().__init__(basis=basis, controls=controls, increments=solved, continuity=k - 2)


def check_end_state(
    condition: object, omega: ArrayLike | None, alpha: ArrayLike | None, side: str, order: int
) -> Floats | None:
    """Return the velocity and, for orders 5 and 6, acceleration given at one end, ``(c, 3)``.

    Raises:
        ValueError: the condition is not one, or what is given does not go with it.
    """
    is_natural = check_choice(condition, side, ENDS) == "natural"
    if is_natural and (omega is not None or alpha is not None):
        name = f"omega_{side}" if omega is not None else f"alpha_{side}"
        raise ValueError(f"{name} must be None with {side}='natural'; use {side}='clamped'")
    if is_natural:
        return None
    if omega is None:
        raise ValueError(f"omega_{side} must be given with {side}='clamped', got None")
    velocity = check_vector(omega, f"omega_{side}")
    if order < 5:
        if alpha is not None:
            raise ValueError(f"alpha_{side} must be None for order {order}, got {alpha!r}")
        return velocity[None]
    acceleration = np.zeros(3) if alpha is None else check_vector(alpha, f"alpha_{side}")
    return np.stack([velocity, acceleration])


def begun_shares(basis: CumulativeBasis, instants: Floats) -> Floats:
    """Return how far each function that varies at a keyframe has come there.

    The first one of keyframe *i* belongs to increment *i*: the span that begins at the keyframe or
    contains it has the same number.

    Returns:
        Shape ``(n, f)``, *f* the functions under way at a keyframe.
    """
    functions = basis.values.shape[1]
    is_odd_order = functions % 2 == 0
    width = functions if is_odd_order else functions - 1
    shares = np.ones((len(instants), width))
    shares[:-1] = basis.at(np.arange(len(instants) - 1), instants[:-1])[0, :width].T
    return shares


def end_rows(
    basis: CumulativeBasis, given: Floats | None, *, is_end: bool
) -> tuple[Floats, Floats]:
    """Return the linear conditions on the outermost increments, counted from their end.

    Args:
        basis: of the curve.
        given: velocity and, with two conditions, acceleration; nothing for a natural end.
        is_end: whether it is the last end.

    Returns:
        Coefficients ``(c, 3)`` and right sides ``(c, 3)``.
    """
    functions = basis.values.shape[1]
    count = functions // 2
    derivatives = outer_derivatives(basis, is_end=is_end)
    rows, known = np.zeros((count, 3)), np.zeros((count, 3))
    if given is None:
        rows[:, : min(3, functions)] = derivatives[1 : 1 + count, : min(3, functions)]
        return rows / np.max(np.abs(rows), axis=1, keepdims=True), known
    outer = given[0] / (2.0 * derivatives[0, 0])
    rows[0, 0], known[0] = 1.0, outer
    if count == 2:
        # Seen from the last keyframe the turn of the last factor stands before the others.
        half = 0.5 * rotate(exp_half(outer), given[1]) if is_end else 0.5 * given[1]
        rows[1, 1] = 1.0
        known[1] = (half - derivatives[1, 0] * outer) / derivatives[1, 1]
    return rows, known


def outer_derivatives(basis: CumulativeBasis, *, is_end: bool) -> Floats:
    """Return three derivatives of the three outermost functions at one end, ``(3, 3)``."""
    span = -1 if is_end else 0
    width = float(np.diff(basis.breaks)[span])
    rates, curvatures = basis.rates[span], basis.curvatures[span]
    degree = curvatures.shape[1] - 1
    third = degree * np.diff(curvatures, axis=1) / width
    third = third if degree > 0 else np.zeros((len(curvatures), 1))
    found = np.zeros((3, 3))
    order: Indices = np.arange(len(rates))[::-1] if is_end else np.arange(len(rates))
    for row, coefficients in enumerate((rates, curvatures, third)):
        values = coefficients[order, -1 if is_end else 0][:3]
        found[row, : len(values)] = values
    return found
