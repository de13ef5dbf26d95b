"""The coefficients of B-spline bases on their spans, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The formulas are those of
:mod:`orientd.curves.basis`, which is the reference, one span after the other.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import float64, int64, njit, types, void

from orientd.curves.basis import Indices
from orientd.curves.compiled_rotation import inner
from orientd.curves.fast import FillBasis
from orientd.rotation import Floats


@inner
def _add_times_line(
    coefficients: Floats, degree: int, at_start: float, at_end: float, out: Floats
) -> None:
    """Add a polynomial of degree ``degree - 1`` in Bernstein form times a straight line."""
    for j in range(degree):
        out[j] += (1.0 - j / degree) * at_start * coefficients[j]
        out[j + 1] += (j + 1) / degree * at_end * coefficients[j]


def _fill(
    spans: Indices, knots: Floats, order: int, values: Floats, rates: Floats, curvatures: Floats
) -> None:
    """Write the coefficients of some spans.

    Args:
        spans: index of the knot that each begins at, shape ``(S,)``.
        knots: the knot vector.
        order: degree plus one.
        values: receives the Bernstein coefficients of the cumulative functions, see
            :class:`~orientd.curves.basis.CumulativeBasis`.
        rates: receives those of their derivatives.
        curvatures: receives those of their second derivatives.
    """
    # Of the last three degrees: the B-splines that are not zero, in Bernstein coefficients.
    stages = np.zeros((order, order, order))
    for s in range(len(spans)):
        span = spans[s]
        here, there = knots[span], knots[span + 1]
        stages[:] = 0.0
        stages[0, 0, 0] = 1.0
        for degree in range(1, order):
            for row in range(degree):
                begin = span - degree + 1 + row
                start, stop = knots[begin], knots[begin + degree]
                width = stop - start
                lower = stages[degree - 1, row]
                up, down = (here - start) / width, (stop - here) / width
                _add_times_line(lower, degree, up, (there - start) / width, stages[degree, row + 1])
                _add_times_line(lower, degree, down, (stop - there) / width, stages[degree, row])
        for d in range(order):
            total = 0.0
            for row in range(order - 1, 0, -1):
                total += stages[order - 1, row, d]
                values[s, row - 1, d] = total
        for row in range(order - 1):
            index = span - order + 2 + row
            scale = (order - 1) / (knots[index + order - 1] - knots[index])
            for d in range(order - 1):
                rates[s, row, d] = scale * stages[order - 2, row, d]
            for d in range(order - 2):
                slope = 0.0
                if row > 0:
                    below = knots[index + order - 2] - knots[index]
                    slope += (order - 2) / below * stages[order - 3, row - 1, d]
                if row < order - 2:
                    below = knots[index + order - 1] - knots[index + 1]
                    slope -= (order - 2) / below * stages[order - 3, row, d]
                curvatures[s, row, d] = scale * slope


_SPANS = types.Array(int64, 1, "A", readonly=True)
_KNOTS = types.Array(float64, 1, "A", readonly=True)
_OUT = float64[:, :, ::1]
_SIGNATURE = void(_SPANS, _KNOTS, int64, _OUT, _OUT, _OUT)

fill: FillBasis = cast(
    FillBasis, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_fill)
)
