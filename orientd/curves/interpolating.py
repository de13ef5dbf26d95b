"""Cumulative B-splines through keyframes: one solver for orders 3 to 6, and the default method."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd import kernels
from orientd.curves.contract import Ends, WithEndStates, prescribed
from orientd.curves.keyframes import (
    ParameterError,
    check_integer,
    check_turns,
    increments,
    with_turns,
)
from orientd.curves.products import Parts, Product, product_trajectory, squared_acceleration
from orientd.errors import PlanError
from orientd.rotation import Floats, align, exp, multiply

_NO_STEPS: Floats = np.empty((0, 3))
_FREE = np.zeros(3)
_ENDS = {"natural": (0, 0), "clamped": (1, 2)}


Spline = tuple[Floats, Parts]
"""Start and end of the spans of a product, s, and its factors."""


def interpolate(
    keys: Floats,
    times: Floats,
    order: int,
    ends: Ends,
    *,
    turns: ArrayLike | None = None,
    near: Floats | None = None,
) -> Spline:
    r"""Return the cumulative B-spline of order *k* through keyframes, continuous to k - 2.

    Even orders have their knots at the keyframes, odd ones in the middle between them.  Both ends
    are repeated *k* times, so each end needs *c* conditions: 1 for orders 3 and 4, 2 for 5 and 6.
    A free end has no acceleration, and with *c* = 2 no jerk either.  With :math:`\tilde B` at the
    first time, velocity and acceleration determine

    .. math:: 2 \tilde B_1' w_1 = \Omega, \qquad
              2 (\tilde B_1'' w_1 + \tilde B_2'' w_2) = \dot\Omega

    and the mirrored equations hold at the last time.  An end of order 4 with both given has one
    more knot, in the middle of its interval.

    Between two neighbouring keyframes only a few factors of the product vary.  This gives one
    equation in a few increments for each interval.  The kernel solves these by Newton's method on
    the increments themselves, so they may exceed pi.  ``search.c`` describes how it finds large
    steps.

    Args:
        keys: unit quaternions with the intended signs, shape ``(n, 4)``.
        times: increasing, s, shape ``(n,)``.
        order: 3 to 6.
        ends: conditions at the first keyframe and at the last.
        turns: whole turns to add between each keyframe and the next.  With two or more the spline
            also passes an orientation after each part of the turn, where it has a knot.
        near: increments near the intended solution.

    Raises:
        PlanError: the search found no spline.
    """
    steps = _NO_STEPS
    if turns is not None:
        keys, times, turns = _divided(keys, times, turns)
        turned, keys = with_turns(increments(keys), keys, turns)
        steps = turned if np.any(turns) else _NO_STEPS
    known = [(omega is not None) + (alpha is not None) for omega, alpha in ends]
    given = np.array([[_FREE if vector is None else vector for vector in end] for end in ends])
    spans = len(keys) - 1 + (order % 2 if order != 4 else (known[0] == 2) + (known[1] == 2))
    breaks, base = np.empty(spans + 1), np.empty((spans, 4))
    vectors = np.empty((spans + order - 2, 3)) if near is None else near.copy()
    values = np.empty((spans, order - 1, order))
    is_found = kernels.interpolate(
        *(keys, steps, times, order),
        *(given, known[0], known[1], near is not None),
        *(breaks, base, vectors, values),
    )
    if not is_found:
        raise PlanError(
            f"no spline of order {order} was found through the keyframes: add keyframes, lower the "
            "end velocities or give them turns to coast through, or make neighbouring intervals "
            "more alike"
        )
    return breaks, (base, np.arange(spans), vectors, values)


def _divided(keys: Floats, times: Floats, turns: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return keyframes with at most one whole turn from each to the next.

    Two whole turns can shrink to none without a break, and the search for large steps then finds a
    spline that makes fewer.
    """
    counts = check_turns(turns, len(keys) - 1)
    if not np.any(np.abs(counts) > 1):
        return keys, times, counts
    steps, _ = with_turns(increments(keys), keys, counts)
    parts = np.maximum(np.abs(counts), 1).astype(int)
    places = [np.arange(part) / part for part in parts]
    inner = [
        multiply(key, exp(2.0 * place[:, None] * step))
        for key, step, place in zip(keys, steps, places, strict=False)
    ]
    instants = [
        begin + place * (end - begin)
        for begin, end, place in zip(times, times[1:], places, strict=False)
    ]
    key_times = np.append(np.concatenate(instants), times[-1])
    through = align(np.concatenate([*inner, keys[-1:]]))
    return through, key_times, np.repeat(np.sign(counts), parts)


def unwound(keys: Floats, times: Floats, order: int, ends: Ends, w: Floats) -> list[Spline]:
    """Return other solutions, in which one long inner increment has fewer whole turns.

    With fast ends, the continuation from small steps may add useless turns.  An increment of more
    than pi / 2 turns by more than half a revolution, so it may have gone the wrong way round.
    """
    found, outer = [], (order - 1) // 2
    for j in range(outer, len(w) - outer):
        length = float(np.sqrt(np.sum(w[j] ** 2)))
        least = int(length / (2.0 * np.pi))
        for turns in (least, least + 1) if length > np.pi / 2.0 else ():
            near = w.copy()
            near[j] *= 1.0 - 2.0 * np.pi * turns / length
            with suppress(PlanError):
                if turns > 0:
                    found.append(interpolate(keys, times, order, ends, near=near))
    return found


class C2Cumulative(Product, WithEndStates):
    r"""Pass through keyframes at their times with continuous velocity and acceleration.

    .. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_{j,4}(t)\bigr)

    The cumulative cubic B-spline of Kim, Kim and Shin (1995), sec. 5.3, with the keyframes' times
    as simple knots and fourfold end knots.  The paper's curve approximates its control quaternions.
    Here a solver finds increments with which the curve meets every keyframe.  The authors' paper at
    Computer Animation '95 does so for unit-spaced keyframes.  Let :math:`w_1` be the first
    increment and :math:`\tilde B` the basis at the first time:

    * ``"natural"``: no acceleration, :math:`\tilde B_1'' w_1 + \tilde B_2'' w_2 = 0`;
    * ``"clamped"``: the angular velocity given, :math:`2 \tilde B_1' w_1 = \Omega`;
    * ``"state"``: angular velocity and acceleration both given.  One more knot in the middle of the
      end interval adds the unknown for this (an extension of the paper).  With two keyframes and
      both ends in this state, the knots divide the interval in three.

    The conditions at the end are the mirror image.  Moving a keyframe changes the curve everywhere,
    by an amount that decays quickly with distance.

    Picture: ``orientd plot c2_cumulative``.

    Args:
        turns: whole turns to add between each keyframe and the next, about the axis of the turn
            between them.  With two or more the curve also passes an orientation after each part of
            the turn.

    Raises:
        PlanError: the search found no curve.  This does not happen for steps below 178 degrees with
            moderate end velocities.
    """

    name = "c2_cumulative"
    summary = "C2 interpolation, end velocities met; the default"
    source = "Kim, Kim and Shin 1995, sec. 5.3, made to interpolate"
    meets_end_accelerations = True
    own: ClassVar[Mapping[str, Any]] = {"turns": None}

    def _solve(self, q: Floats, instants: Floats, ends: Ends, *, turns: ArrayLike | None) -> None:
        self._set_parts(*interpolate(q, instants, 4, ends, turns=turns), 2)


class KksInterpolating(Product, WithEndStates):
    r"""Pass through keyframes with a cumulative B-spline of order *k*, continuous to order k - 2.

    .. math:: q(t) = q_0 \prod_i \exp\bigl(w_i \tilde B_{i,k}(t)\bigr)

    Kim, Kim and Shin (1995), sec. 5.3, whose curve approximates its control quaternions; here a
    solver finds the increments *w*.  Order 4 is ``c2_cumulative``.  Order 6 also has continuous
    jerk and rate of the jerk, as stiff drives and cameras require.  The knots are the keyframes'
    times for even orders and the middles between them for odd ones, with ends repeated *k* times.
    So each end needs *c* conditions, 1 for orders 3 and 4, 2 for 5 and 6:

    * ``"natural"``: no acceleration; with *c* = 2 no jerk either;
    * ``"clamped"``: the angular velocity given; with *c* = 2 the angular acceleration too.

    At a clamped end only the first function has a slope, and only the first two a curvature.  So
    with all values at the first time :math:`2 \tilde B_1' w_1 = \Omega`, :math:`2 (\tilde B_1'' w_1
    + \tilde B_2'' w_2) = \dot\Omega`.  Without acceleration the first increments are parallel, and
    the jerk is :math:`2 \sum_{i \le 3} \tilde B_i''' w_i`.

    Moving a keyframe changes the curve everywhere, by an amount that decays with distance.  The
    build time is proportional to the number of keyframes.

    Picture: ``orientd plot kks_interpolating``.

    Args:
        order: degree plus one, 3 to 6.
        alpha_start: body angular acceleration there, rad/s^2, if clamped with orders 5 and 6;
            zero by default.
        alpha_end: body angular acceleration at the last keyframe.
        turns: whole turns to add between each keyframe and the next, about the axis of the turn
            between them; a fast end can use some to slow down.  With two or more the curve also
            passes an orientation after each part of the turn.

    Raises:
        PlanError: the search found no curve.  This may happen for ends of more than 20 rad/s over
            intervals of 1 s, unless *turns* absorb their speed.
    """

    name = "kks_interpolating"
    summary = "cumulative B-spline of order 3 to 6 through keyframes, up to C4"
    source = "Kim, Kim and Shin 1995, sec. 5.3, made to interpolate"
    conditions = _ENDS
    own: ClassVar[Mapping[str, Any]] = {"order": 6, "turns": None}

    def _solve(
        self,
        q: Floats,
        instants: Floats,
        ends: Ends,
        *,
        order: int,
        turns: ArrayLike | None,
    ) -> None:
        k = check_integer(order, "order", minimum=3, maximum=6)
        states = []
        for side, (omega, alpha) in zip(("start", "end"), ends, strict=True):
            if alpha is not None and k < 5:
                name = f"alpha_{side}"
                raise ParameterError(name, f"{name} must be None for order {order}, got {alpha!r}")
            is_still = omega is not None and alpha is None and k > 4
            states.append((omega, _FREE if is_still else alpha))
        asked = states[0], states[1]
        self._ends = prescribed(asked)
        spline = interpolate(q, instants, k, asked, turns=turns)
        if k != 4 and turns is None:
            others = unwound(q, instants, k, asked, spline[1][2])
            spline = min([spline, *others], key=_effort) if others else spline
        self._set_parts(*spline, k - 2)
        self._key_times = instants

    @property
    def key_times(self) -> Floats:
        """The times of the keyframes, which for odd orders are not the knots, ``(n,)``."""
        times: Floats = self._key_times.copy()
        return times


def _effort(spline: Spline) -> float:
    return squared_acceleration(product_trajectory(*spline).sample, spline[0])
