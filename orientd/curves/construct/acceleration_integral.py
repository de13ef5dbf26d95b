"""The integral of squared angular acceleration, by which curves are compared."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orientd.curves.contract import Samples
from orientd.rotation import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

Path = Callable[[Floats], Samples]
"""Orientation, angular velocity and angular acceleration at instants."""


def squared_acceleration(path: Path, times: Floats) -> float:
    """Return the integral of squared angular acceleration, by Gauss's rule in each interval."""
    h = np.diff(times)[:, None]
    alpha = path((times[:-1, None] + 0.5 * h * (1.0 + _NODES)).ravel())[2]
    squares = np.sum(alpha * alpha, axis=1).reshape(len(h), -1)
    return float(np.sum(0.5 * h * _WEIGHTS * squares))
