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

import math
from dataclasses import dataclass

import numpy as np

from orientd.curves.basis import Indices
from orientd.errors import PlanError
from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply, right_jacobian, rotate

_BLOCK = 1024
"""Rows linearised at a time, so that intermediate results stay in the cache."""

_CONTRACTION = 0.25
"""A Newton correction must shrink at least so fast, or the scale grows by less."""

_LARGEST_GUESS_ERROR = 0.4
"""The first correction of predicted increments must not be longer, in rad of half angle."""

_REACH = 10
"""How many keyframes away a correction may be forgotten: it decays by 0.27 with each."""

_LARGEST_SHARE_OF_ROWS = 0.2
_POLISHINGS = 5
_SMALLEST_GROWTH = 1e-5
_ROUNDING = 1e-7
"""After a correction as small as this one the next, its square, is lost in rounding."""

_ON_THE_WAY = 1e-2
"""How small a correction has to be before the full scale is reached."""

_DESCENT_ITERATIONS = 300
_SMALLEST_SHARE = 1e-6


@dataclass(frozen=True)
class _Path:
    """The last points of a continuation path, and its direction at the first."""

    scales: list[float]
    points: list[Floats]
    tangent: Floats

    def at(self, scale: float) -> Floats:
        """Return the polynomial through the points, carried on to another scale, as a new array.

        From the first point, where nothing turns yet, the path goes along the tangent.
        """
        if len(self.points) == 1:
            return self.points[0] + (scale - self.scales[0]) * self.tangent
        total = np.zeros_like(self.tangent)
        for i, point in enumerate(self.points):
            others = [other for j, other in enumerate(self.scales) if j != i]
            weight = math.prod((scale - other) / (self.scales[i] - other) for other in others)
            total += weight * point
        return total

    def extended(self, scale: float, point: Floats) -> _Path:
        """Return the path with one more point, the oldest of four dropped."""
        return _Path([*self.scales[-2:], scale], [*self.points[-2:], point], self.tangent)


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
            PlanError: neither continuation nor the descent from the Euclidean spline arrives.
        """
        found = self._continue()
        if found is None:
            found = self._descend()
        if found is None:
            raise PlanError(
                "no twice differentiable interpolant was found through the keyframes: add "
                "keyframes, lower the end velocities or make neighbouring intervals more alike"
            )
        return self._complete(found, 1.0)

    def _continue(self) -> Floats | None:
        """Return the solution that is connected with small rotations, if there is a path to it."""
        everything = np.arange(len(self.steps))
        start = _Path([0.0], [np.zeros_like(self.steps)], self._linear_solution())
        found = self._march(everything, start, 1.0, growth=1.0)
        for _ in range(_POLISHINGS):
            if found is None:
                break
            correction = self._correction(found, 1.0, everything)
            found = found + correction
            if np.max(np.abs(correction)) <= _ROUNDING:
                return found
        return None

    def _march(self, rows: Indices, path: _Path, target: float, growth: float) -> Floats | None:
        """Return the increments with those of some rows carried on to a target scale.

        The increments of the other rows follow the polynomial through the path so far.
        """
        while path.scales[-1] < target:
            scale = min(target, path.scales[-1] + growth)
            found = self._attempt(rows, path, scale)
            if found is None:
                growth *= 0.5
                if growth < _SMALLEST_GROWTH:
                    return None
                continue
            growth = 2.0 * (scale - path.scales[-1])
            path = path.extended(scale, found)
        return path.points[-1]

    def _attempt(self, rows: Indices, path: _Path, scale: float) -> Floats | None:
        """Return the increments at a scale, if Newton's method converges to them quickly.

        Where a few rows are in the way, they are carried there in smaller steps by themselves: a
        correction decays by 0.27 with each keyframe, so the others hardly take notice.
        """
        here = path.at(scale)
        found, bad = self._newton(here, scale, rows)
        if not len(bad):
            return found
        window = self._around(bad, rows)
        if len(window) > _LARGEST_SHARE_OF_ROWS * len(rows):
            return None
        carried = self._march(window, path, scale, growth=0.5 * (scale - path.scales[-1]))
        if carried is None:
            return None
        here[window] = carried[window]
        found, bad = self._newton(here, scale, rows)
        return None if len(bad) else found

    def _newton(self, here: Floats, scale: float, rows: Indices) -> tuple[Floats, Indices]:
        """Return improved increments, and the rows at which the corrections shrink too slowly."""
        here = here.copy()
        limit = _LARGEST_GUESS_ERROR
        enough = _ROUNDING if scale == 1.0 else _ON_THE_WAY
        while True:
            correction = self._correction(here, scale, rows)
            size = np.max(np.abs(correction), axis=1)
            is_bad = ~(size <= limit)
            if np.any(is_bad):
                return here, rows[is_bad]
            here[rows] += correction
            is_moving = size > enough
            limit = max(_CONTRACTION * float(np.max(size)), _ROUNDING)
            if not np.any(is_moving):
                return here, rows[:0]
            rows = self._around(rows[is_moving], rows)

    def _around(self, some: Indices, rows: Indices) -> Indices:
        """Return those rows that are within reach of some of them."""
        changes = np.zeros(len(self.steps) + 1, dtype=np.intp)
        np.add.at(changes, np.maximum(some - _REACH, 0), 1)
        np.add.at(changes, np.minimum(some + _REACH + 1, len(self.steps)), -1)
        return rows[np.cumsum(changes)[rows] > 0]

    def _descend(self) -> Floats | None:
        """Return a solution near the Euclidean spline, by Newton's method with step control.

        It serves where the continuation path folds back before it arrives: intervals of very
        different lengths with large steps.  The solution is one of several then.
        """
        everything = np.arange(len(self.steps))
        here = self._linear_solution()
        error = self._error(here)
        for _ in range(_DESCENT_ITERATIONS):
            correction = self._correction(here, 1.0, everything)
            share = 1.0
            while True:
                tried = here + share * correction
                error_there = self._error(tried)
                if error_there <= (1.0 - 0.1 * share) * error or error_there < _ROUNDING**2:
                    break
                share *= 0.5
                if share < _SMALLEST_SHARE:
                    return None
            here, error = tried, error_there
            if share == 1.0 and np.max(np.abs(correction)) <= _ROUNDING:
                return here
        return None

    def _error(self, unknown: Floats) -> float:
        """Return the sum of the squared half angles by which the keyframes are missed."""
        factors = exp_half(self.share[..., None] * self._complete(unknown, 1.0)[self.index])
        product = factors[:, 0]
        for f in range(1, factors.shape[1]):
            product = multiply(product, factors[:, f])
        return float(np.sum(log_half(multiply(conjugate(exp_half(self.steps)), product)) ** 2))

    def _complete(self, unknown: Floats, scale: float) -> Floats:
        """Return all increments, the settled ones at both ends included."""
        heads, tails = self.start.ratio * unknown[:1], self.end.ratio * unknown[-1:]
        if len(self.start.known):
            heads = scale * self.start.known
        if len(self.end.known):
            tails = scale * self.end.known[::-1]
        return np.concatenate([heads, unknown, tails])

    def _correction(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        r"""Return one Newton step of some rows, the other unknowns staying as they are.

        With :math:`P` the product of a row and :math:`e = \log(E^{-1} P)` its error, the row says
        :math:`\sum_f c_f R(S_f)^T J_r(2 c_f w_f)\, \delta w_f = -e`, where :math:`S_f` is the
        product of the factors after *f*: the right Jacobian leaves a multiple of its own axis
        as it is, so it need not be applied to *e*.
        """
        increments = self._complete(unknown, scale)
        blocks: Floats = np.zeros((len(rows), 3, 3, 3))
        error: Floats = np.empty((len(rows), 3))
        for begin in range(0, len(rows), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            self._linearise(rows[part], increments, scale, blocks[part], error[part])
        is_apart = np.diff(rows) > 1
        blocks[1:, 0][is_apart] = 0.0
        blocks[:-1, 2][is_apart] = 0.0
        return _solve_block_tridiagonal(blocks, -error)

    def _linearise(
        self, rows: Indices, increments: Floats, scale: float, blocks: Floats, error: Floats
    ) -> None:
        """Write the errors of some rows and their derivatives by the unknowns around each."""
        index, share = self.index[rows], self.share[rows]
        turns = share[..., None] * increments[index]
        factors = exp_half(turns)
        jacobians = share[..., None, None] * right_jacobian(2.0 * turns)
        after = np.zeros((len(index), 4))
        after[:, 0] = 1.0
        for f in reversed(range(index.shape[1])):
            turned = rotate(conjugate(after)[:, None], np.swapaxes(jacobians[:, f], 1, 2))
            self._add(blocks, rows, index[:, f], np.swapaxes(turned, 1, 2))
            after = multiply(factors[:, f], after)
        targets = exp_half(scale * self.steps[rows])
        error[:] = log_half(multiply(conjugate(targets), after))

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

    def _linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        count = len(self.steps)
        blocks: Floats = np.zeros((count, 3, 3, 3))
        for f in range(self.index.shape[1]):
            self._add(
                blocks, np.arange(count), self.index[:, f], self.share[:, f, None, None] * np.eye(3)
            )
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
