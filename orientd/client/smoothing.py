r"""Smooth the poses of a chunk within a tolerance.

The poses of a policy are noisy, and a curve through each of them shows the noise as acceleration.
The smoothing spline (Reinsch 1967) has the least integral of the squared second derivative, plus
the sum of squares of its distances from the poses times a weight.  The weight here is the one at
which the largest distance is the tolerance.

For orientations the curve is that of the rotation vectors from pose to pose, added up.  Each
correction is a rotation in the frame of its pose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orientd import rotation

Floats = NDArray[np.float64]

_STEPS = 40
_LEAST, _MOST = -14.0, 8.0
"""Decimal logarithms between which the weight of the second derivative is sought, s^3."""


def smoothed_orientations(times: Floats, q: Floats, tolerance: float) -> Floats:
    """Return *q*, each turned by at most *tolerance*.

    Args:
        times: ascending, shape ``(n,)``, s.
        q: unit quaternions, shape ``(n, 4)``.
        tolerance: rad.
    """
    ways = rotation.log(rotation.between(q[:-1], q[1:]))
    turns = _corrections(times, np.vstack([np.zeros(3), np.cumsum(ways, axis=0)]), tolerance)
    return rotation.multiply(q, rotation.exp(turns))


def smoothed_positions(times: Floats, positions: Floats, tolerance: float) -> Floats:
    """Return *positions*, each moved by at most *tolerance*.

    Args:
        times: ascending, shape ``(n,)``, s.
        positions: shape ``(n, 3)``, m.
        tolerance: m.
    """
    return positions + _corrections(times, positions, tolerance)


def _corrections(times: Floats, points: Floats, tolerance: float) -> Floats:
    """Return what is added to each of the points, of which at least three can be moved."""
    if len(times) < 3:
        return np.zeros_like(points)
    roughness, modes = np.linalg.eigh(_roughness(times))
    roughness, parts = np.maximum(roughness, 0.0), modes.T @ points
    low, high = _LEAST, _MOST
    found = np.zeros_like(points)
    for _ in range(_STEPS):
        weight = 0.5 * (low + high)
        share = 1.0 - 1.0 / (1.0 + 10.0**weight * roughness)
        moved = -modes @ (share[:, None] * parts)
        if np.linalg.norm(moved, axis=1).max() > tolerance:
            high = weight
        else:
            low, found = weight, moved
    return found


def _roughness(times: Floats) -> Floats:
    """Return the matrix of the integral of the squared second derivative, shape ``(n, n)``.

    It belongs to the natural cubic spline through points at *times* (Green and Silverman 1994,
    section 2.1.2).
    """
    spans, inner = np.diff(times), np.arange(len(times) - 2)
    second = np.zeros((len(times), len(inner)))
    second[inner, inner] = 1.0 / spans[:-1]
    second[inner + 1, inner] = -1.0 / spans[:-1] - 1.0 / spans[1:]
    second[inner + 2, inner] = 1.0 / spans[1:]
    gram = np.diag((spans[:-1] + spans[1:]) / 3.0)
    gram += np.diag(spans[1:-1] / 6.0, 1) + np.diag(spans[1:-1] / 6.0, -1)
    found: Floats = second @ np.linalg.solve(gram, second.T)
    return found
