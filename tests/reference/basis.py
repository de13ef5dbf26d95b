"""The coefficients of cumulative B-spline bases on their spans, in plain NumPy."""

import numpy as np


def coefficients(spans, knots, order):
    """Values, rates and curvatures of :class:`orientd.curves.basis.CumulativeBasis`.

    Args:
        spans: index of the knot that each begins at, shape ``(S,)``.
        knots: the knot vector.
        order: degree plus one.
    """
    stages = [np.ones((len(spans), 1, 1))]
    for degree in range(1, order):
        stages.append(_raised(stages[-1], knots, spans, degree))
    values = np.cumsum(stages[-1][:, ::-1], axis=1)[:, ::-1][:, 1:]
    index = spans[:, None] - order + 2 + np.arange(order - 1)
    support = knots[index + order - 1] - knots[index]
    rates = (order - 1) / support[..., None] * stages[-2]
    curvatures = np.zeros((len(spans), order - 1, max(order - 2, 1)))
    if order > 2:
        index = index[:, 1:]
        support_below = knots[index + order - 2] - knots[index]
        slopes = (order - 2) / support_below[..., None] * stages[-3]
        curvatures[:, 1:] += slopes
        curvatures[:, :-1] -= slopes
        curvatures *= (order - 1) / support[..., None]
    return values, rates, curvatures


def _raised(lower, knots, spans, degree):
    """Take the non-zero B-splines of each span from one degree to the next.

    Row *a* of *lower* is the B-spline of degree ``degree - 1`` that begins at knot
    ``span - degree + 1 + a``, in Bernstein coefficients on the span.
    """
    higher = np.zeros((len(spans), degree + 1, degree + 1))
    here, there = knots[spans], knots[spans + 1]
    for row in range(degree):
        begin = spans - degree + 1 + row
        start, stop = knots[begin], knots[begin + degree]
        width = stop - start
        part = lower[:, row]
        higher[:, row + 1] += _times_line(part, (here - start) / width, (there - start) / width)
        higher[:, row] += _times_line(part, (stop - here) / width, (stop - there) / width)
    return higher


def _times_line(coefficients, at_start, at_end):
    """Multiply polynomials in Bernstein form by straight lines given by their end values."""
    degree = coefficients.shape[-1]
    share = np.arange(1, degree + 1) / degree
    product = np.zeros((len(coefficients), degree + 1))
    product[:, :-1] += (1.0 - np.arange(degree) / degree) * at_start[:, None] * coefficients
    product[:, 1:] += share * at_end[:, None] * coefficients
    return product
