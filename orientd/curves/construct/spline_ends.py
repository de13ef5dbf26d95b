r"""Where an interpolating B-spline has its knots, and what its ends ask of the first increments.

Even orders have their knots at the keyframes, odd ones in the middles between them; so both ends
always need the same number of conditions, *c* = 1 for orders 3 and 4, 2 for 5 and 6.  At an end
with repeated knots only the outermost function has a slope, the outer two a curvature, the outer
three a third derivative, which makes every condition a linear one on the outermost increments.
"""

from __future__ import annotations

import numpy as np

from orientd.curves.construct.basis import CumulativeBasis, Indices
from orientd.rotation import Floats


def interpolation_knots(instants: Floats, order: int) -> Floats:
    """Return the knot vector of the interpolating spline of an order, ends repeated.

    >>> interpolation_knots(np.array([0.0, 1.0, 3.0]), 3).tolist()
    [0.0, 0.0, 0.0, 0.5, 2.0, 3.0, 3.0, 3.0]
    """
    inner = instants[1:-1] if order % 2 == 0 else 0.5 * (instants[1:] + instants[:-1])
    return np.concatenate([np.repeat(instants[0], order), inner, np.repeat(instants[-1], order)])


def begun_shares(basis: CumulativeBasis, instants: Floats) -> Floats:
    """Return how far each function that varies at a keyframe has come there.

    The first one of keyframe *i* belongs to increment *i*: the span that begins at the keyframe or
    contains it has the same number.

    Returns:
        Shape ``(n, f)``, *f* the functions under way at a keyframe.
    """
    functions = basis.values.shape[1]
    is_odd_order = functions % 2 == 0
    width = functions if is_odd_order else functions - 1
    shares = np.ones((len(instants), width))
    shares[:-1] = basis.at(np.arange(len(instants) - 1), instants[:-1])[0, :width].T
    return shares


def end_rows(
    basis: CumulativeBasis, given: Floats | None, *, is_end: bool
) -> tuple[Floats, Floats]:
    """Return the linear conditions on the outermost increments, counted from their end.

    Args:
        basis: of the curve.
        given: derivative and, with two conditions, second derivative there, as the outermost
            functions times their increments make them; nothing for a natural end.
        is_end: whether it is the last end.

    Returns:
        Coefficients ``(c, 3)`` and right sides ``(c, 3)``.
    """
    functions = basis.values.shape[1]
    count = functions // 2
    derivatives = outer_derivatives(basis, is_end=is_end)
    rows, known = np.zeros((count, 3)), np.zeros((count, 3))
    if given is None:
        rows[:, : min(3, functions)] = derivatives[1 : 1 + count, : min(3, functions)]
        return rows / np.max(np.abs(rows), axis=1, keepdims=True), known
    rows[0, 0], known[0] = 1.0, given[0] / derivatives[0, 0]
    if count == 2:
        rows[1, 1] = 1.0
        known[1] = (given[1] - derivatives[1, 0] * known[0]) / derivatives[1, 1]
    return rows, known


def outer_derivatives(basis: CumulativeBasis, *, is_end: bool) -> Floats:
    """Return three derivatives of the three outermost functions at one end, ``(3, 3)``."""
    span = -1 if is_end else 0
    width = float(np.diff(basis.breaks)[span])
    rates, curvatures = basis.rates[span], basis.curvatures[span]
    degree = curvatures.shape[1] - 1
    third = degree * np.diff(curvatures, axis=1) / width
    third = third if degree > 0 else np.zeros((len(curvatures), 1))
    found = np.zeros((3, 3))
    order: Indices = np.arange(len(rates))[::-1] if is_end else np.arange(len(rates))
    for row, coefficients in enumerate((rates, curvatures, third)):
        values = coefficients[order, -1 if is_end else 0][:3]
        found[row, : len(values)] = values
    return found
