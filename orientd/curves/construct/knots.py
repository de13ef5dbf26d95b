"""Knot vectors: checks, multiplicity, and the clamped ones that interpolation uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.keyframes import ParameterError
from orientd.rotation import Floats


def resolve_knots(knots: ArrayLike | None, count: int, order: int) -> Floats:
    """Return a knot vector for *count* control points of a B-spline of an order, in seconds.

    Without *knots* they are a second apart, and the domain begins at 0.

    Raises:
        ValueError: it is not ``count + order`` finite numbers that do not decrease, the domain
            from ``knots[order - 1]`` to ``knots[count]`` is empty, or a knot inside it is
            repeated so often that the curve would jump.
    """
    if knots is None:
        return np.arange(1 - order, count + 1, dtype=np.float64)
    expected = f"a list of {count + order} non-decreasing numbers"
    try:
        vector = np.asarray(knots)
    except ValueError as error:
        raise ParameterError("knots", f"knots must be {expected}, got {knots!r}") from error
    if vector.dtype.kind not in "iuf" or vector.shape != (count + order,):
        raise ParameterError(
            "knots",
            f"knots must be {expected} for {count} control quaternions of order {order}, "
            f"got {vector.dtype} of shape {vector.shape}",
        )
    vector = vector.astype(np.float64)
    if not np.all(np.isfinite(vector)):
        raise ParameterError(
            "knots", f"knots must be finite, got {vector[~np.isfinite(vector)][0]!r}"
        )
    if np.any(np.diff(vector) < 0.0):
        place = int(np.argmax(np.diff(vector) < 0.0))
        raise ParameterError(
            "knots",
            f"knots must not decrease, got knots[{place + 1}] = {float(vector[place + 1])!r} "
            f"after knots[{place}] = {float(vector[place])!r}",
        )
    if not vector[count] > vector[order - 1]:
        raise ParameterError(
            "knots",
            f"knots must leave a domain from knots[{order - 1}] to knots[{count}], "
            f"got {float(vector[count])!r} for both",
        )
    multiplicity = inner_multiplicity(vector, order)
    if multiplicity >= order:
        raise ParameterError(
            "knots",
            f"knots inside the domain must be repeated at most {order - 1} times for order "
            f"{order}, got one repeated {multiplicity} times",
        )
    return vector


def inner_multiplicity(vector: Floats, order: int) -> int:
    """Return how often the most repeated knot strictly inside the domain occurs, 0 without any."""
    start, end = vector[order - 1], vector[len(vector) - order]
    inner = vector[(vector > start) & (vector < end)]
    if not len(inner):
        return 0
    return int(np.unique(inner, return_counts=True)[1].max())
