"""Predict where a target is, from the positions that a program sends about once a second.

The positions are fitted as points on the unit sphere.  Azimuth and elevation would not do: near the
zenith both change without bound while the target moves steadily.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_MOST = 12
"""Positions that are kept."""
_SIZES = (12, 8, 5, 3)
"""Numbers of positions of a fit; the largest that fits is used."""
_FIT = 1e-4
"""Largest deviation of a position from its fit, in addition to its rounding, rad."""
_LONGEST_GAP = 20.0
"""Seconds after which a position does not continue the earlier ones."""
_SHARE = 0.35
"""Largest surprise of a position that continues the earlier ones, relative to its step."""
_SLACK = math.radians(0.1)
"""Surprise that is always allowed, rad."""


class Prediction:
    """A steady path through positions of a target; immutable.

    Attributes:
        gap: the longest of the last three times from one position to the next, s; 0 before two.
        speed: of the target at its newest position, rad/s.
    """

    def __init__(
        self,
        times: Sequence[float] = (),
        points: Sequence[Floats] = (),
        *,
        rounding: float = 0.0,
    ) -> None:
        """Fit positions.

        Args:
            times: of each position, s, ascending.
            points: unit vectors, each of shape ``(3,)``.
            rounding: of the positions, rad.
        """
        self._times, self._points, self._rounding = times, points, rounding
        self.gap = max((b - a for a, b in pairwise(times[-4:])), default=0.0)
        self._path = _path(times, points, _FIT + rounding) if times else np.zeros((1, 3))
        self.speed = float(np.linalg.norm(self._path[1])) if len(self._path) > 1 else 0.0

    def added(self, time: float, point: Floats) -> Prediction:
        """Return the prediction with one more position.

        It starts over from the last two positions if the new one is not about where the earlier
        ones lead.

        Args:
            time: of the position, s.
            point: unit vector, shape ``(3,)``.
        """
        if not self._times or not self._times[-1] < time < self._times[-1] + _LONGEST_GAP:
            return Prediction([time], [point], rounding=self._rounding)
        kept = _MOST - 1 if self.is_path and self._leads_to(time, point) else 1
        return Prediction(
            [*self._times[-kept:], time],
            [*self._points[-kept:], point],
            rounding=self._rounding,
        )

    def rounded(self, rounding: float) -> Prediction:
        """Return the prediction for positions with another rounding, rad."""
        return Prediction(self._times, self._points, rounding=rounding)

    @property
    def is_path(self) -> bool:
        """Whether at least two positions give a rate."""
        return len(self._times) > 1

    @property
    def is_confirmed(self) -> bool:
        """Whether a third position was about where the earlier ones lead."""
        return len(self._times) > 2

    def at(self, time: ArrayLike) -> Floats:
        """Return the predicted unit vectors at *time*, shape ``(..., 3)``."""
        ahead = np.asarray(time, dtype=np.float64)[..., None] - self._times[-1]
        found: Floats = ahead ** np.arange(len(self._path)) @ self._path
        unit: Floats = found / np.linalg.norm(found, axis=-1, keepdims=True)
        return unit

    def _leads_to(self, time: float, point: Floats) -> bool:
        step, surprise = math.dist(self._points[-1], point), math.dist(self.at(time), point)
        return surprise < _SHARE * step + _SLACK + 2.0 * self._rounding


def _path(times: Sequence[float], points: Sequence[Floats], tolerance: float) -> Floats:
    """Return the coefficients of time since the newest position, shape ``(degree + 1, 3)``."""
    since, rows = np.array(times) - times[-1], np.array(points)
    course: Floats = rows[-1:]
    for size in _SIZES:
        if size > len(since) and size > _SIZES[-1]:
            continue
        powers = np.vander(since[-size:], min(3, len(since)), increasing=True)
        course = np.asarray(np.linalg.lstsq(powers, rows[-size:], rcond=None)[0])
        if np.max(np.abs(powers @ course - rows[-size:])) < tolerance:
            break
    return course
