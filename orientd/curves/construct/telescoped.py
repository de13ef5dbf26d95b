r"""The increments of a cumulative B-spline of any order that passes through keyframes.

Between two neighbouring keyframes all but a few factors of the product are complete or not begun:

.. math:: q_i^{-1} q_{i+1} = \Bigl(\prod_f \exp(b_{i,f}\, w_{i+f})\Bigr)^{-1} \exp(w_i)
          \prod_f \exp(b_{i+1,f}\, w_{i+1+f})

where *b* says how far each function has come at a keyframe.  These equations and linear conditions
on the outermost increments are solved by Newton's method on the increments themselves, so that an
increment may pass pi and keep its winding.  Large steps are reached by continuation: steps and end
conditions are scaled from nothing, where the spline is that of Euclidean space, to their full size;
where that folds back on its way, Newton's method with step control looks for a solution near it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orientd.curves.construct.banded import solve_blocks
from orientd.errors import PlanError
from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply, right_jacobian, rotate

ITERATIONS = 12
CONTRACTION = 0.5
"""A Newton correction must shrink at least so fast, or the continuation step is halved."""

LARGEST_CORRECTION = 0.75
"""In rad of half angle, beyond which a guess is too far from its solution."""

SMALLEST_STEP = 1e-3
SMALLEST_SHARE = 1e-5
DESCENTS = 300
ROUNDING = 1e-8


@dataclass(frozen=True)
class TelescopedEquations:
    """What the increments of a spline through keyframes satisfy.

    Attributes:
        shares: how far the functions under way at each keyframe have come, shape ``(n + 1, f)``.
        steps: half-angle vectors from each keyframe to the next, shape ``(n, 3)``.
        head: coefficients of the first three increments in each condition there, ``(c, 3)``.
        head_known: right sides, shape ``(c, 3)``.
        tail: coefficients of the last three increments, the last one first, ``(c, 3)``.
        tail_known: right sides.
    """

    shares: Floats
    steps: Floats
    head: Floats
    head_known: Floats
    tail: Floats
    tail_known: Floats

    def solve(self) -> Floats:
        """Return all increments, shape ``(n + 2 c, 3)``.

        Raises:
            PlanError: neither continuation nor a descent from the Euclidean spline arrives.
        """
        found = self._continue()
        if found is None:
            found = self._descend()
        if found is None:
            raise PlanError(
                "no cumulative spline of this order was found through the keyframes: add "
                "keyframes, lower the end velocities or give them turns to coast through, make "
                "neighbouring intervals more alike or take a lower order"
            )
        return found

    def unwound(self, w: Floats) -> list[Floats]:
        """Return other solutions: one inner increment of more than pi has lost whole turns.

        Where the ends are fast, the way up from small steps may gather turns that lead nowhere.
        """
        found = []
        for j in range(len(self.head), len(w) - len(self.tail)):
            length = float(np.sqrt(np.sum(w[j] ** 2)))
            if length <= math.pi:
                continue
            least = int(length / (2.0 * math.pi))
            for turns in (least, least + 1):
                guess = w.copy()
                guess[j] *= 1.0 - 2.0 * math.pi * turns / length
                settled = self._newton(guess, 1.0) if turns > 0 else None
                if settled is not None:
                    found.append(settled)
        return found

    def _continue(self) -> Floats | None:
        """Return the solution connected with small steps, if the way there does not fold back."""
        reached, stride = 0.0, 1.0
        found = np.zeros((len(self.steps) + len(self.head) + len(self.tail), 3))
        tangent = self.linear_solution()
        while reached < 1.0:
            target = min(1.0, reached + stride)
            settled = self._newton(found + (target - reached) * tangent, target)
            if settled is None:
                stride *= 0.5
                if stride < SMALLEST_STEP:
                    return None
            else:
                tangent = (settled - found) / (target - reached)
                found, reached, stride = settled, target, 2.0 * (target - reached)
        return found

    def _descend(self) -> Floats | None:
        """Return a solution near the Euclidean spline, by Newton's method with step control."""
        w = self.linear_solution()
        step, error = self._correction(w, 1.0)
        for _ in range(DESCENTS):
            share = 1.0
            while True:
                tried = w + share * step
                next_step, reached = self._correction(tried, 1.0)
                if reached <= (1.0 - 0.1 * share) * error or reached < ROUNDING**2:
                    break
                share *= 0.5
                if share < SMALLEST_SHARE:
                    return None
            size = float(np.max(np.abs(step)))
            w, step, error = tried, next_step, reached
            if share == 1.0 and size <= ROUNDING:
                return w
        return None

    def _newton(self, w: Floats, scale: float) -> Floats | None:
        """Return the solution near a guess, or nothing if it is not near enough."""
        previous = LARGEST_CORRECTION / CONTRACTION
        for _ in range(ITERATIONS):
            step, _ = self._correction(w, scale)
            size = float(np.max(np.abs(step)))
            if not size <= max(CONTRACTION * previous, ROUNDING):
                return None
            w = w + step
            if size <= ROUNDING:
                return w
            previous = size
        return None

    def _factors(self) -> list[tuple[int, Floats]]:
        """Return offset and share of each factor between two keyframes, in their order."""
        before, after = self.shares[:-1], self.shares[1:]
        width = before.shape[1]
        factors = [(f, -before[:, f]) for f in range(width - 1, 0, -1)]
        factors.append((0, 1.0 - before[:, 0]))
        return factors + [(1 + f, after[:, f]) for f in range(width)]

    def _correction(self, w: Floats, scale: float) -> tuple[Floats, float]:
        r"""Return one Newton step, and the sum of squared errors before it.

        With *P* the product of a row and :math:`e = \log(E^{-1} P)` its error, the row says
        :math:`\sum_f c_f R(S_f)^T J_r(2 c_f w_f)\, \delta w_f = -e`, where :math:`S_f` is the
        product of the factors after *f*; a right Jacobian leaves multiples of its axis alone.
        """
        count = len(self.steps)
        rows = np.arange(count)
        blocks = np.zeros((count, 3, 3 * (1 + self.shares.shape[1])))
        after = np.zeros((count, 4))
        after[:, 0] = 1.0
        for offset, share in reversed(self._factors()):
            turn = share[:, None] * w[rows + offset]
            jacobian = share[:, None, None] * right_jacobian(2.0 * turn)
            carried = rotate(conjugate(after)[:, None], np.swapaxes(jacobian, 1, 2))
            blocks[:, :, 3 * offset : 3 * offset + 3] += np.swapaxes(carried, 1, 2)
            after = multiply(exp_half(turn), after)
        error = log_half(multiply(exp_half(-scale * self.steps), after))
        head = self.head @ w[: self.head.shape[1]] - scale * self.head_known
        reversed_w = w[::-1][: self.tail.shape[1]]
        tail = self.tail @ reversed_w - scale * self.tail_known
        errors = np.concatenate([head, error, tail[::-1]])
        return -self._solve(blocks, errors), float(np.sum(errors * errors))

    def linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        blocks = np.zeros((len(self.steps), 3, 3 * (1 + self.shares.shape[1])))
        for offset, share in self._factors():
            blocks[:, :, 3 * offset : 3 * offset + 3] += share[:, None, None] * np.eye(3)
        right = np.concatenate([self.head_known, self.steps, self.tail_known[::-1]])
        return self._solve(blocks, right)

    def _solve(self, blocks: Floats, right: Floats) -> Floats:
        """Solve the rows of the keyframes together with those of the ends."""
        count, conditions = len(blocks), len(self.head)
        size = 3 * len(right)
        width = max(9, blocks.shape[2])
        wide = np.zeros((count + 2 * conditions, 3, width))
        wide[conditions : conditions + count, :, : blocks.shape[2]] = blocks
        for i, (head, tail) in enumerate(zip(self.head, self.tail, strict=True)):
            for j in range(3):
                wide[i, :, 3 * j : 3 * j + 3] = head[j] * np.eye(3)
                place = width - 3 * j
                wide[-1 - i, :, place - 3 : place] = tail[j] * np.eye(3)
        rows = 3 * np.arange(len(wide))
        columns = np.concatenate(
            [
                np.zeros(conditions, dtype=np.intp),
                3 * np.arange(count),
                np.full(conditions, size - width, dtype=np.intp),
            ]
        )
        return solve_blocks(wide, rows, columns, right.ravel()).reshape(-1, 3)
