"""A curve on another clock: the same orientations, earlier or later, quicker or slower."""

from __future__ import annotations

import numpy as np

from orientd.curves.contract import Curve, Samples
from orientd.rotation import Floats


class Retimed(Curve):
    """Run through *curve* evenly from *start* to *end*.

    Args:
        curve: any curve.
        start: where its domain begins now, s.
        end: where it ends, s, greater than *start*.
    """

    def __init__(self, curve: Curve, start: float, end: float) -> None:
        first, last = curve.domain
        self._curve = curve
        self._first = first
        self._rate = (last - first) / (end - start)
        knots = start + (curve.knots - first) / self._rate
        knots[0], knots[-1] = start, end
        super().__init__(knots=knots, continuity=curve.continuity)

    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        # Rounding must not carry an instant over a knot: each stays in the span it is in here.
        inner = self._first + (times - self._start) * self._rate
        before = self._curve.knots[span]
        last = span == len(self._knots) - 2
        after = self._curve.knots[span + 1]
        inner = np.clip(inner, before, np.where(last, after, np.nextafter(after, -np.inf)))
        q, omega_body, alpha_body = self._curve.evaluate(inner)
        return q, self._rate * omega_body, self._rate**2 * alpha_body
