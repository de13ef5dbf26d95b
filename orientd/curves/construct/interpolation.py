r"""The equations that make a cumulative cubic B-spline pass through given keyframes.

One for each interval between keyframes, in as many unknown increments, half-angle vectors; see
``equations_t`` of the kernels' ``interpolation.h``.  Steps and end conditions carry a common scale:
at 0 nothing turns, at 1 they have their full size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orientd.curves.construct.basis import Indices
from orientd.kernels import euclidean_increments, find_increments, keyframe_errors, keyframe_step
from orientd.rotation import Floats

_NONE: Floats = np.empty((0, 3))


class KeyframeEquations(NamedTuple):
    """One telescoped product for each interval between keyframes, in the order of the kernels.

    Attributes:
        steps: half-angle vectors from each keyframe to the next, shape ``(N, 3)``.
        begun: how much of the two factors under way at each keyframe has been turned there, shape
            ``(N + 1, 2)``; (1, 0) at an end where two increments are known.
        heads: increments known at the start, the outermost first, shape ``(0..2, 3)``.
        tails: those known at the end, the outermost first.
        start_ratio: with no heads, the outermost increment is this multiple of the next one.
        end_ratio: the same at the end.
    """

    steps: Floats
    begun: Floats
    heads: Floats
    tails: Floats
    start_ratio: float
    end_ratio: float

    def complete(self, unknown: Floats) -> Floats:
        """Return all increments, the settled ones at both ends included."""
        heads = self.heads if len(self.heads) else self.start_ratio * unknown[:1]
        tails = self.tails[::-1] if len(self.tails) else self.end_ratio * unknown[-1:]
        return np.concatenate([heads, unknown, tails])

    def errors(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        """Return the half-angle vectors by which some rows miss their steps, shape ``(n, 3)``."""
        errors: Floats = np.empty((len(rows), 3))
        keyframe_errors(*self, scale, unknown, rows, errors)
        return errors

    def correction(
        self, unknown: Floats, scale: float, rows: Indices, errors: Floats = _NONE
    ) -> Floats:
        """Return one Newton step of some rows, the other unknowns staying as they are.

        Args:
            unknown: half-angle vectors, shape ``(N, 3)``.
            scale: of the steps and end conditions.
            rows: increasing row numbers, shape ``(n,)``.
            errors: what the step is to cancel, shape ``(n, 3)``; without it the errors there.

        Returns:
            Half-angle vectors, shape ``(n, 3)``; not finite where the system is singular.
        """
        correction: Floats = np.empty((len(rows), 3))
        keyframe_step(*self, scale, unknown, rows, errors, correction)
        return correction

    def linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        unknown: Floats = np.empty_like(self.steps)
        euclidean_increments(*self, unknown)
        return unknown

    def find(self, unknown: Floats, first: int) -> int:
        """Write what Newton's method alone finds, from the Euclidean spline.

        Where the end conditions leave but one unknown, it is a logarithm, the principal one as in
        the Hermite curve.  Whole turns added to the step are left to the search.

        Args:
            unknown: receives half-angle vectors, shape ``(N, 3)``.
            first: the first one to be found; those before it are known.

        Returns:
            How many are found then; where it does not converge, all before some of the others.
        """
        return find_increments(*self, unknown, first)

    def part(self, unknown: Floats, begin: int, end: int) -> KeyframeEquations:
        """Return some successive equations, with what is known of the increment before them."""
        is_last = end == len(self.steps)
        return self._replace(
            steps=self.steps[begin:end],
            begun=self.begun[begin : end + 1],
            heads=unknown[begin - 1 : begin] if begin else self.heads,
            tails=self.tails if is_last else _NONE,
            end_ratio=self.end_ratio if is_last else 0.0,
        )
