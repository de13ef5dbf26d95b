r"""Barr's discretised least acceleration, by damped Gauss-Newton steps that never raise it.

Between keyframes the curve is cut into equal pieces, over each of which it turns at a constant rate
:math:`\Omega_{k+1/2} = \log(q_k^{-1} q_{k+1}) / h_k`, and the sum of

.. math:: \bar h_k \Bigl\| \frac{\Omega_{k+1/2} - \Omega_{k-1/2}}{\bar h_k} \Bigr\|^2,
          \qquad \bar h_k = \tfrac12 (h_{k-1} + h_k)

is minimised over the orientations between the keyframes (Barr et al., 1992, with the tangential
acceleration taken from logarithms).  The result is off by the square of the piece; it serves to
bring a guess near the curve that Newton's method then finds exactly.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Path, solve_blocks
from orientd.curves.interpolating import C2Cumulative
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    conjugate,
    exp,
    left_jacobian_inverse,
    log_half,
    multiply,
    normalize,
    right_jacobian_inverse,
)

Spline = TypeVar("Spline", bound=RotationVectorSpline | C2Cumulative)

PIECES = 16
"""At least, between two keyframes."""

TURN = 0.4
"""Rad, at most, over a piece of the guess."""

MOST_PIECES = 250
ITERATIONS = 200
SETTLED = 1e-4
"""Relative decrease in one step at which the sum is near enough to its minimum."""


def relaxed(path: Path, knots: Floats, first: Floats | None, last: Floats | None) -> Path | None:
    """Return a curve of little acceleration through the keyframes of a guess.

    Args:
        path: the guess.
        knots: instants of its keyframes.
        first: velocity wanted at the first keyframe; free without it.
        last: the same at the last keyframe.

    Returns:
        A rotation-vector spline through the minimum's orientations; nothing if the guess turns
        too much, or it has none.
    """
    h = np.diff(knots)[:, None]
    omega = path((knots[:-1, None] + h * np.arange(PIECES) / PIECES).ravel())[1]
    fastest = np.sqrt(np.sum(omega * omega, axis=1)).reshape(len(h), -1).max(axis=1, keepdims=True)
    pieces = max(PIECES, int(np.ceil(np.max(fastest * h) / TURN)))
    if pieces > MOST_PIECES:
        return None
    times = np.append((knots[:-1, None] + h * np.arange(pieces) / pieces).ravel(), knots[-1])
    q = normalize(path(times)[0])
    is_free = np.ones(len(times), dtype=bool)
    is_free[::pieces] = False
    sums = _Sums(np.diff(times), is_free, first, last)
    damping = 1e-3
    value = sums.value(q)
    for _ in range(ITERATIONS):
        step = sums.step(q, damping)
        moved = normalize(multiply(q, exp(step)))
        reached = sums.value(moved)
        if reached < value:
            decrease = value - reached
            q, value, damping = moved, reached, max(0.2 * damping, 1e-9)
            if decrease < SETTLED * value:
                break
        else:
            damping *= 5.0
            if damping > 1e9:
                break
    return spline_path(RotationVectorSpline, q, times, first, last)


def spline_path(
    family: type[RotationVectorSpline | C2Cumulative],
    q: Floats,
    instants: Floats,
    first: Floats | None,
    last: Floats | None,
    **options: ArrayLike,
) -> Path | None:
    """Return the path of :func:`spline_through` keyframes, if there is one."""
    spline = spline_through(family, q, instants, first, last, **options)
    return None if spline is None else spline.evaluate


def spline_through(
    family: type[Spline],
    q: Floats,
    instants: Floats,
    first: Floats | None,
    last: Floats | None,
    **options: ArrayLike,
) -> Spline | None:
    """Return a spline with the same keyframes and ends, if there is one.

    Args:
        family: of the spline.
        q: orientations of the keyframes, their signs as the spline is to have them.
        instants: of the keyframes, s.
        first: body angular velocity at the first keyframe, rad/s; natural without it.
        last: the same at the last keyframe.
        options: of the family.
    """
    try:
        return family(
            keys=q,
            times=instants,
            start="natural" if first is None else "clamped",
            end="natural" if last is None else "clamped",
            omega_start=first,
            omega_end=last,
            align=False,
            **options,
        )
    except (PlanError, ValueError):
        return None


class _Sums:
    """The sum of squared accelerations as a function of the orientations."""

    def __init__(
        self, h: Floats, is_free: np.ndarray, first: Floats | None, last: Floats | None
    ) -> None:
        self._h, self._is_free = h, is_free
        self._first, self._last = first, last
        between = 0.5 * (h[1:] + h[:-1])
        self._spans = np.concatenate([[0.5 * h[0]], between, [0.5 * h[-1]]])

    def value(self, q: Floats) -> float:
        """Return the sum."""
        residual = self._residual(self._turns(q) / self._h[:, None])
        return float(np.sum(residual * residual))

    def step(self, q: Floats, damping: float) -> Floats:
        """Return the damped Gauss-Newton step as body rotation vectors, ``(m, 3)``."""
        turns = self._turns(q)
        residual = self._residual(turns / self._h[:, None])
        # How the rate of a piece changes with the orientation at its end and at its start.
        rate = (1.0 / self._h)[:, None, None]
        ahead, behind = rate * right_jacobian_inverse(turns), -rate * left_jacobian_inverse(turns)
        weight = (1.0 / np.sqrt(self._spans))[:, None, None]
        count = len(q)
        # Residual k depends on nodes k - 1, k and k + 1.
        rows = np.zeros((count, 3, 9))
        rows[:-1, :, 3:6] += weight[:-1] * behind
        rows[:-1, :, 6:9] += weight[:-1] * ahead
        rows[1:, :, 0:3] -= weight[1:] * behind
        rows[1:, :, 3:6] -= weight[1:] * ahead
        if self._first is None:
            rows[0] = 0.0
        if self._last is None:
            rows[-1] = 0.0
        free = np.zeros((count + 2, 3))
        free[1:-1] = self._is_free[:, None]
        window = np.concatenate([free[:-2], free[1:-1], free[2:]], axis=1)
        rows *= window[:, None]
        normal = np.swapaxes(rows, 1, 2) @ rows
        gradient = np.zeros((count + 2, 3))
        for place in range(3):
            part = np.einsum("nij,ni->nj", rows[:, :, 3 * place : 3 * place + 3], residual)
            np.add.at(gradient, np.arange(count) + place, part)
        diagonal = np.zeros((count + 2, 3))
        for place in range(3):
            index = np.arange(3) + 3 * place
            diagonal[place : place + count] += normal[:, index, index]
        pinned = np.where(free > 0.0, damping * diagonal, 1.0)
        size = 3 * (count + 2)
        nodes = 3 * np.arange(count)
        blocks = np.concatenate([normal, np.zeros((count + 2, 9, 9))])
        blocks[count:, np.arange(3), np.arange(3)] = pinned
        starts = np.concatenate([nodes, 3 * np.arange(count + 2)])
        solution = solve_blocks(blocks, starts, starts, -gradient.reshape(size))
        return solution.reshape(-1, 3)[1:-1]

    def _turns(self, q: Floats) -> Floats:
        turns: Floats = 2.0 * log_half(multiply(conjugate(q[:-1]), q[1:]))
        return turns

    def _residual(self, rates: Floats) -> Floats:
        """Return root-weighted accelerations at all nodes, those of natural ends zero."""
        start = rates[:1] if self._first is None else self._first[None]
        end = rates[-1:] if self._last is None else self._last[None]
        change = np.diff(np.concatenate([start, rates, end]), axis=0)
        residual: Floats = change / np.sqrt(self._spans)[:, None]
        return residual
