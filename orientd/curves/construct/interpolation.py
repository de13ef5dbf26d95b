r"""The equations that make a cumulative cubic B-spline pass through given keyframes.

One for each interval between keyframes, in as many unknown increments, half-angle vectors; see
``equations_t`` of the kernels' ``interpolation.h``.  Steps and end conditions carry a common scale:
at 0 nothing turns, at 1 they have their full size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.construct.basis import Indices
from orientd.kernels import (
    euclidean_increments,
    find_increments,
    keyframe_errors,
    keyframe_step,
)
from orientd.rotation import Floats

_NONE: Floats = np.empty((0, 3))


@dataclass(frozen=True)
class EndCondition:
    """What is known of the increments at one end, counted from that end.

    Attributes:
        known: the outermost increments, half-angle vectors, shape ``(0..2, 3)``.
        ratio: with none known, the outermost increment is this multiple of the next one.
    """

    known: Floats
    ratio: float = 0.0


@dataclass(frozen=True)
class KeyframeEquations:
    """One telescoped product for each interval between keyframes.

    Attributes:
        steps: half-angle vectors from each keyframe to the next, shape ``(N, 3)``.
        begun: how much of the two factors under way at each keyframe has been turned there, shape
            ``(N + 1, 2)``; (1, 0) at an end where two increments are known.
        start: condition at the first keyframe.
        end: condition at the last keyframe.
    """

    steps: Floats
    begun: Floats
    start: EndCondition
    end: EndCondition

    def complete(self, unknown: Floats) -> Floats:
        """Return all increments, the settled ones at both ends included."""
        heads = self.start.known if len(self.start.known) else self.start.ratio * unknown[:1]
        tails = self.end.known[::-1] if len(self.end.known) else self.end.ratio * unknown[-1:]
        return np.concatenate([heads, unknown, tails])

    def errors(self, unknown: Floats, scale: float, rows: Indices) -> Floats:
        """Return the half-angle vectors by which some rows miss their steps, shape ``(n, 3)``."""
        errors: Floats = np.empty((len(rows), 3))
        keyframe_errors(*self._arrays(), scale, unknown, rows, errors)
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
        keyframe_step(*self._arrays(), scale, unknown, rows, errors, correction)
        return correction

    def linear_solution(self) -> Floats:
        """Return the increments of the spline in Euclidean space with the same steps."""
        unknown: Floats = np.empty_like(self.steps)
        euclidean_increments(*self._arrays(), unknown)
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
        return find_increments(*self._arrays(), unknown, first)

    def part(self, unknown: Floats, begin: int, end: int) -> KeyframeEquations:
        """Return some successive equations, with what is known of the increment before them."""
        return KeyframeEquations(
            self.steps[begin:end],
            self.begun[begin : end + 1],
            EndCondition(unknown[begin - 1 : begin]) if begin else self.start,
            self.end if end == len(self.steps) else EndCondition(_NONE),
        )

    def _arrays(self) -> tuple[Floats, Floats, Floats, Floats, float, float]:
        start, end = self.start, self.end
        return self.steps, self.begun, start.known, end.known, start.ratio, end.ratio
