"""Polynomials of degree five by values and two derivatives at both ends.

The one from 0 to 1 between rests, :math:`10u^3 - 15u^4 + 6u^5`, begins and ends a change softly.
"""

from __future__ import annotations

import math

import numpy as np

from orientd import kernels
from orientd.rotation import Floats

QUINTIC = 6
"""Number of coefficients."""

UNIT_VELOCITY, UNIT_ACCELERATION, UNIT_JERK = 1.875, 10.0 / math.sqrt(3.0), 60.0
"""Peaks of the derivatives of the quintic from 0 to 1 between rests."""


def quintics(intervals: Floats, points: Floats, velocities: Floats, pushes: Floats) -> Floats:
    """Return the quintics between values with first and second derivatives.

    Args:
        intervals: their durations, s, shape ``(n - 1,)``.
        points: the values, shape ``(n, m)``, as the others.
        velocities: first derivatives there.
        pushes: second derivatives there.

    Returns:
        Coefficients of the powers of the time since each begins, shape ``(n - 1, 6, m)``.
    """
    ends = np.stack([points, velocities, pushes])
    found: Floats = np.empty((len(intervals), QUINTIC, ends.shape[2]))
    kernels.put_quintics(np.ascontiguousarray(intervals), ends.ravel(), found.ravel())
    return found


def quintic(
    first: tuple[Floats, Floats, Floats], last: tuple[Floats, Floats, Floats], duration: float
) -> Floats:
    """Return the quintic between two values with first and second derivatives, ``(6, m)``."""
    pieces = quintics(np.array([duration]), *map(np.stack, zip(first, last, strict=True)))
    only: Floats = pieces[0]
    return only


_SMOOTH = quintics(np.ones(1), np.array([[0.0], [1.0]]), *np.zeros((2, 2, 1)))[0, ::-1, 0]


def smooth_step(u: Floats) -> Floats:
    """Return the quintic from 0 to 1 between rests; constant outside."""
    return np.polyval(_SMOOTH, np.clip(u, 0.0, 1.0)).astype(np.float64)
