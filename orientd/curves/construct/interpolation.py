"""Cumulative B-splines through keyframes: the one solver of all orders from 3 to 6."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from orientd import kernels
from orientd.errors import PlanError
from orientd.rotation import Floats

End = tuple[Floats | None, Floats | None]
"""Body angular velocity and acceleration prescribed at an end, ``None`` where they are free."""

_NO_STEPS: Floats = np.empty((0, 3))
_FREE = np.zeros(3)


class Spline(NamedTuple):
    """A cumulative B-spline with simple knots inside its domain.

    Attributes:
        breaks: where its spans begin and end, s, shape ``(S + 1,)``.
        base: the quaternion before the product of each span, shape ``(S, 4)``.
        increments: half-angle vectors, those of span *s* from number *s* on.
        values: Bernstein coefficients of the functions that vary, shape ``(S, k - 1, k)``.
    """

    breaks: Floats
    base: Floats
    increments: Floats
    values: Floats


def interpolate(
    keys: Floats,
    times: Floats,
    order: int,
    ends: tuple[End, End],
    *,
    steps: Floats | None = None,
    near: Floats | None = None,
) -> Spline:
    r"""Return the cumulative B-spline of an order *k* through keyframes, continuous to k - 2.

    Even orders have their knots at the keyframes, odd ones in the middles between them, both ends
    repeated *k* times, so that both ends need *c* conditions, 1 for orders 3 and 4, 2 for 5 and 6.
    A free end has no acceleration; with *c* = 2 no jerk either.  With :math:`\tilde B` taken at
    the first instant, velocity and acceleration settle

    .. math:: 2 \tilde B_1' w_1 = \Omega, \qquad
              2 (\tilde B_1'' w_1 + \tilde B_2'' w_2) = \dot\Omega

    and at the last instant the same seen from there.  An end of order 4 with both given has one
    more knot, in the middle of its interval.

    Between two neighbouring keyframes all but a few factors of the product are complete or not
    begun, which leaves one equation in a few increments for each interval.  The kernel solves these
    by Newton's method on the increments themselves, so that they may pass pi; ``search.c`` says how
    it finds large steps.

    Args:
        keys: unit quaternions with the signs wanted, shape ``(n, 4)``.
        times: increasing instants, s, shape ``(n,)``.
        order: 3 to 6.
        ends: what is prescribed at the first keyframe and at the last.
        steps: half-angle vectors from each keyframe to the next where they turn by more than the
            logarithm says, shape ``(n - 1, 3)``.
        near: increments near the solution wanted.

    Raises:
        PlanError: no such spline was found.
    """
    known = [sum(vector is not None for vector in end) for end in ends]
    given = np.array([[_FREE if vector is None else vector for vector in end] for end in ends])
    spans = len(keys) - 1 + (order % 2 if order != 4 else (known[0] == 2) + (known[1] == 2))
    found = Spline(
        np.empty(spans + 1),
        np.empty((spans, 4)),
        np.empty((spans + order - 2, 3)) if near is None else near.copy(),
        np.empty((spans, order - 1, order)),
    )
    is_found = kernels.interpolate(
        *(keys, _NO_STEPS if steps is None else steps, times, order),
        *(given, known[0], known[1], near is not None),
        *(found.breaks, found.base, found.increments, found.values),
    )
    if not is_found:
        raise PlanError(
            f"no spline of order {order} was found through the keyframes: add keyframes, lower the "
            "end velocities or give them turns to coast through, or make neighbouring intervals "
            "more alike"
        )
    return found


def unwound(
    keys: Floats, times: Floats, order: int, ends: tuple[End, End], w: Floats
) -> list[Spline]:
    """Return other solutions: one inner increment of more than pi has lost whole turns.

    Where the ends are fast, the way up from small steps may gather turns that lead nowhere.
    """
    found, outer = [], (order - 1) // 2
    for j in range(outer, len(w) - outer):
        length = float(np.sqrt(np.sum(w[j] ** 2)))
        least = int(length / (2.0 * np.pi))
        for turns in (least, least + 1) if length > np.pi else ():
            near = w.copy()
            near[j] *= 1.0 - 2.0 * np.pi * turns / length
            with suppress(PlanError):
                if turns > 0:
                    found.append(interpolate(keys, times, order, ends, near=near))
    return found
