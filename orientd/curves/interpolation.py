r"""The equations that make a cumulative B-spline pass through given keyframes.

Between two neighbouring keyframes the product telescopes to a few factors,

.. math:: \prod_f \exp(c_f w_{j_f}) = q_i^{-1} q_{i+1},

one equation in half-angle vectors for each interval, in the increments :math:`w_j` themselves.
They are never taken from logarithms of control quaternions, so they may pass pi and keep their
winding: it is the cut of the logarithm, not the equations, that stops a solver with principal
logarithms.  The derivatives are block tridiagonal.

Steps and end conditions carry a common scale: at 0 nothing turns, at 1 they have their full size.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orientd.curves import fast
from orientd.curves.basis import Indices
from orientd.rotation import (
    Floats,
    between,
    conjugate,
    exp_half,
    log_half,
    multiply,
    right_jacobian,
    rotate,
)

_PIECE = 2048
_OVERLAP = 32


@dataclass(frozen=True)
class EndCondition:
    """What is known of the increments at one end, counted from that end.

    Attributes:
        known: the outermost increments, half-angle vectors, shape ``(0..2, 3)``.
        ratio: with none known, the outermost increment is this multiple of the next one.
    """

    known: Floats
    ratio: float = 0.0

    @property
    def count(self) -> int:
        """How many increments the condition settles."""
        return max(1, len(self.known))


@dataclass(frozen=True)
class KeyframeEquations:
    """One telescoped product for each interval between keyframes.

    Attributes:
        index: which increment each factor takes, shape ``(N, F)``.
        share: how much of it, shape ``(N, F)``; zero where a row has fewer factors.
        steps: half-angle vectors from each keyframe to the next, shape ``(N, 3)``.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
    """

    index: Indices
    share: Floats
    steps: Floats
    start: EndCondition
    end: EndCondition

    def complete(self, unknown: Floats, scale: float) -> Floats:
        """Return all increments, the settled ones at both ends included."""
        heads, tails = self._settled(unknown, scale)
        return np.concatenate([heads, unknown, tails])

    def _settled(self, unknown: Floats, scale: float) -> tuple[Floats, Floats]:
        heads, tails = self.start.ratio * unknown[:1], self.end.ratio * unknown[-1:]
        if len(self.start.known):
            heads = scale * self.start.known
        if len(self.end.known):
            tails = scale * self.end.known[::-1]
        return heads, tails

    def _factors(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        """Return the half-angle vectors of the factors of some rows, shape ``(n, F, 3)``."""
        heads, tails = self._settled(unknown, scale)
        place = self.index[rows] - len(heads)
        taken = unknown[np.clip(place, 0, len(unknown) - 1)]
        for settled, is_there, first in (
            (heads, place < 0, -len(heads)),
            (tails, place >= len(unknown), len(unknown)),
        ):
            if np.any(is_there):
                taken[is_there] = settled[place[is_there] - first]
        return self.share[rows, :, None] * taken

    def errors(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        """Return the half-angle vectors by which some rows miss their steps, shape ``(n, 3)``."""
        factors = exp_half(self._factors(unknown, scale, rows))
        product = factors[:, 0]
        for f in range(1, factors.shape[1]):
            product = multiply(product, factors[:, f])
        return log_half(between(exp_half(scale * self.steps[rows]), product))

    def linearised(self, unknown: Floats, scale: float, rows: Indices) -> tuple[Floats, Floats]:
        r"""Return derivatives and errors of some rows, the other unknowns taken as constants.

        With :math:`P` the product of a row and :math:`e = \log(E^{-1} P)` its error, a Newton step
        obeys :math:`\sum_f c_f R(S_f)^T J_r(2 c_f w_f)\, \delta w_f = -e`, where :math:`S_f` is the
        product of the factors after *f*: the right Jacobian leaves a multiple of its own axis
        as it is, so it need not be applied to *e*.

        Args:
            unknown: half-angle vectors, shape ``(N, 3)``.
            scale: of the steps and end conditions.
            rows: increasing row numbers, shape ``(n,)``.

        Returns:
            The blocks left of, on and right of the diagonal, shape ``(n, 3, 3, 3)``, and the
            errors, half-angle vectors, shape ``(n, 3)``.
        """
        blocks: Floats = np.zeros((len(rows), 3, 3, 3))
        index, share = self.index[rows], self.share[rows]
        turns = self._factors(unknown, scale, rows)
        factors = exp_half(turns)
        jacobians = share[..., None, None] * right_jacobian(2.0 * turns)
        after = np.zeros((len(index), 4))
        after[:, 0] = 1.0
        for f in reversed(range(index.shape[1])):
            turned = rotate(conjugate(after)[:, None], np.swapaxes(jacobians[:, f], 1, 2))
            self._add(blocks, rows, index[:, f], np.swapaxes(turned, 1, 2))
            after = multiply(factors[:, f], after)
        is_apart = np.diff(rows) > 1
        blocks[1:, 0][is_apart] = 0.0
        blocks[:-1, 2][is_apart] = 0.0
        targets = exp_half(scale * self.steps[rows])
        return blocks, log_half(between(targets, after))

    def _add(self, blocks: Floats, rows: Indices, index: Indices, derivative: Floats) -> None:
        """Add the derivatives of a factor to the blocks of the unknowns it depends on, if any."""
        last = len(self.steps) - 1
        unknown = index - self.start.count
        for end, outside, inside in ((self.start, -1, 0), (self.end, last + 1, last)):
            if not len(end.known):
                is_outside = unknown == outside
                factor = np.where(is_outside, end.ratio, 1.0)
                derivative = factor[:, None, None] * derivative
                unknown = np.where(is_outside, inside, unknown)
        is_free = np.flatnonzero((unknown >= 0) & (unknown <= last))
        blocks[is_free, unknown[is_free] - rows[is_free] + 1] += derivative[is_free]

    def linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        origin = np.zeros_like(self.steps)

        def parts(rows: Indices) -> tuple[Floats, Floats]:
            blocks: Floats = np.zeros((len(rows), 3, 3, 3))
            for f in range(self.index.shape[1]):
                unit = self.share[rows, f, None, None] * np.eye(3)
                self._add(blocks, rows, self.index[rows, f], unit)
            return blocks, np.sum(self._factors(origin, 1.0, rows), axis=1) - self.steps[rows]

        return _solve_by_pieces(np.arange(len(self.steps)), parts)

    def explicit_solution(self) -> Floats | None:
        """Return the only unknown where the end conditions leave but one, or nothing.

        Between two keyframes with both ends given it is a logarithm, the principal one as in the
        Hermite curve.  Whole turns added to the step are left to the search.
        """
        is_single = len(self.steps) == 1 and len(self.start.known) and len(self.end.known)
        if not is_single or float(np.linalg.norm(self.steps)) > math.pi:
            return None
        inner = exp_half(self.steps[0])
        for outer in self.start.known:
            inner = multiply(exp_half(-outer), inner)
        for outer in self.end.known:
            inner = multiply(inner, exp_half(-outer))
        return log_half(inner)[None]

    def correction(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        """Return one Newton step of some rows, the other unknowns staying as they are."""
        if fast.KERNEL.correct is not None:
            correction: Floats = np.empty((len(rows), 3))
            size = fast.KERNEL.correct(
                self.index,
                self.share,
                self.steps,
                scale,
                scale * self.start.known,
                scale * self.end.known,
                self.start.ratio,
                self.end.ratio,
                unknown,
                rows,
                False,
                correction,
            )
            if size < math.inf:
                return correction
        return _solve_by_pieces(rows, lambda piece: self.linearised(unknown, scale, piece))


def _solve_by_pieces(rows: Indices, parts: Callable[[Indices], tuple[Floats, Floats]]) -> Floats:
    """Return the solution that cancels the errors of some rows, given their derivatives.

    Long systems are solved piece by piece, each with neighbours enough on both sides that what
    lies beyond them does not matter to rounding: the pieces fit the cache.
    """
    solution: Floats = np.empty((len(rows), 3))
    for begin in range(0, len(rows), _PIECE):
        first, end = max(0, begin - _OVERLAP), begin + _PIECE
        blocks, error = parts(rows[first : end + _OVERLAP])
        solved = solve_block_tridiagonal(blocks, -error[..., None])[..., 0]
        solution[begin:end] = solved[begin - first : end - first]
    return solution


def solve_block_tridiagonal(blocks: Floats, right: Floats) -> Floats:
    """Solve a system of 3 by 3 blocks.

    Args:
        blocks: for each row of blocks that left of, on and right of the diagonal, ``(n, 3, 3, 3)``.
        right: right-hand sides, shape ``(n, 3, k)``.

    Returns:
        The solutions, shape ``(n, 3, k)``.
    """
    from scipy.linalg import solve_banded

    count = len(blocks)
    reach = min(5, 3 * count - 1)
    band: Floats = np.zeros((2 * reach + 1, 3 * count))
    for side in range(3):
        first, last = max(0, 1 - side), min(count, count + 1 - side)
        for row in range(3):
            for column in range(3):
                diagonal = reach + row - column - 3 * (side - 1)
                if 0 <= diagonal <= 2 * reach and first < last:
                    begin = 3 * (first + side - 1) + column
                    stop = 3 * (last + side - 2) + column + 1
                    band[diagonal, begin:stop:3] = blocks[first:last, side, row, column]
    flat = right.reshape(3 * count, -1)
    solution: Floats = solve_banded(
        (reach, reach), band, flat, overwrite_ab=True, check_finite=False
    )
    return solution.reshape(right.shape)
