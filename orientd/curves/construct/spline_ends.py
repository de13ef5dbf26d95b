"""The derivatives of a cumulative basis at the ends of its domain."""

from __future__ import annotations

import numpy as np

from orientd.curves.construct.basis import CumulativeBasis, Indices
from orientd.rotation import Floats


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
