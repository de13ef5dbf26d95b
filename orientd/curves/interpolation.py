r"""The increments of a cumulative B-spline that passes through given keyframes.

Between two neighbouring keyframes the product telescopes to a few factors,

.. math:: \prod_f \exp(c_f w_{j_f}) = q_i^{-1} q_{i+1},

one equation in half-angle vectors for each interval.  They are solved by Newton's method, whose
matrix is block tridiagonal, in the increments :math:`w_j` themselves.  The increments are never
taken from logarithms of control quaternions, so they may pass pi and keep their winding: it is
the cut of the logarithm, not the equations, that stops a solver with principal logarithms.

Large steps are reached by continuation: the steps between keyframes and the end conditions are
scaled from nothing, where the spline is the one of Euclidean space, up to their full size.  That
also makes the result the branch connected with small rotations, a choice a caller can rely on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.basis import Indices
from orientd.errors import PlanError
from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply, right_jacobian, rotate

_CONTRACTION = 0.25
"""A Newton correction must shrink at least so fast, or the continuation step is halved."""

_LARGEST_GUESS_ERROR = 0.75
"""The first Newton correction of a continuation step must not be longer, in rad of half angle."""

_SMALLEST_STEP = 1e-4
_ITERATIONS = 8
_ROUNDING = 1e-7
"""After a correction as small as this one the next, its square, is lost in rounding."""


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

    def solve(self) -> Floats:
        """Return all increments, shape ``(N + settled by the end conditions, 3)``.

        Raises:
            PlanError: the continuation cannot be carried to the full size of the steps.
        """
        unknown = np.zeros_like(self.steps)
        reached, step = 0.0, 1.0
        tangent = self._linear_solution()
        while reached < 1.0:
            target = min(1.0, reached + step)
            found = self._newton(unknown + (target - reached) * tangent, target)
            if found is None:
                step *= 0.5
                if step < _SMALLEST_STEP:
                    raise PlanError(
                        "no twice differentiable interpolant was found through the keyframes; "
                        f"the search stopped at {100 * reached:.1f} % of the step sizes: add "
                        "keyframes or lower the end velocities"
                    )
                continue
            tangent = (found - unknown) / (target - reached)
            unknown, reached, step = found, target, 2.0 * (target - reached)
        return self._complete(unknown, 1.0)

    def _newton(self, unknown: Floats, scale: float) -> Floats | None:
        """Return the solution at a scale near *unknown*, or nothing if it is not near enough."""
        targets = exp_half(scale * self.steps)
        previous = _LARGEST_GUESS_ERROR / _CONTRACTION
        for _ in range(_ITERATIONS):
            correction = self._correction(self._complete(unknown, scale), targets)
            size = float(np.max(np.abs(correction)))
            if not size <= max(_CONTRACTION * previous, _ROUNDING):
                return None
            unknown = unknown + correction
            if size <= _ROUNDING:
                return unknown
            previous = size
        return None

    def _complete(self, unknown: Floats, scale: float) -> Floats:
        """Return all increments, the settled ones at both ends included."""
        heads = (
            scale * self.start.known if len(self.start.known) else self.start.ratio * unknown[:1]
        )
        tails = scale * self.end.known if len(self.end.known) else self.end.ratio * unknown[-1:]
        return np.concatenate([heads, unknown, tails[::-1]])

    def _correction(self, increments: Floats, targets: Floats) -> Floats:
        r"""Return one Newton step.

        With :math:`P` the product of a row and :math:`e = \log(E^{-1} P)` its error, the row says
        :math:`\sum_f c_f R(S_f)^T J_r(2 c_f w_f)\, \delta w_f = -e`, where :math:`S_f` is the
        product of the factors after *f*: the right Jacobian leaves a multiple of its own axis
        as it is, so it need not be applied to *e*.
        """
        turns = self.share[..., None] * increments[self.index]
        factors = exp_half(turns)
        jacobians = self.share[..., None, None] * right_jacobian(2.0 * turns)
        count, width = self.index.shape
        blocks: Floats = np.zeros((count, 3, 3, 3))
        after = np.zeros((count, 4))
        after[:, 0] = 1.0
        for f in reversed(range(width)):
            turned = rotate(conjugate(after)[:, None], np.swapaxes(jacobians[:, f], 1, 2))
            self._add(blocks, self.index[:, f], np.swapaxes(turned, 1, 2))
            after = multiply(factors[:, f], after)
        error = log_half(multiply(conjugate(targets), after))
        return _solve_block_tridiagonal(blocks, -error)

    def _add(self, blocks: Floats, index: Indices, derivative: Floats) -> None:
        """Add a factor's derivative to the block of the unknown it depends on, if any."""
        count = len(blocks)
        rows = np.arange(count)
        unknown = index - self.start.count
        if not len(self.start.known):
            derivative = np.where(
                (unknown == -1)[:, None, None], self.start.ratio * derivative, derivative
            )
            unknown = np.where(unknown == -1, 0, unknown)
        if not len(self.end.known):
            derivative = np.where(
                (unknown == count)[:, None, None], self.end.ratio * derivative, derivative
            )
            unknown = np.where(unknown == count, count - 1, unknown)
        is_free = (unknown >= 0) & (unknown < count)
        blocks[rows[is_free], (unknown - rows)[is_free] + 1] += derivative[is_free]

    def _linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        count = len(self.steps)
        blocks: Floats = np.zeros((count, 3, 3, 3))
        for f in range(self.index.shape[1]):
            self._add(blocks, self.index[:, f], self.share[:, f, None, None] * np.eye(3))
        settled = self._complete(np.zeros_like(self.steps), 1.0)
        rest = self.steps - np.sum(self.share[..., None] * settled[self.index], axis=1)
        return _solve_block_tridiagonal(blocks, rest)


def _solve_block_tridiagonal(blocks: Floats, right: Floats) -> Floats:
    """Solve a system of 3 by 3 blocks: left, diagonal and right block of each row of blocks."""
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
    solution: Floats = solve_banded(
        (reach, reach), band, right.reshape(-1), overwrite_ab=True, check_finite=False
    )
    return solution.reshape(-1, 3)
