"""Predict where a target is, from the positions that a program sends about once a second.

The positions are fitted as points on the unit sphere.  Azimuth and elevation would not do: near the
zenith both change without bound while the target moves steadily.

A program may send a position early or late.  gpredict 2.3, for example, sends where the target will
be up to half a second later, or was up to half a second ago.  The more positions a polynomial is
fitted to, the less such errors count, and the less it can follow a target that turns.  So each
polynomial is judged by its own past: how well it would have predicted the newest positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats

_FITS = ((1, 3), (1, 8), (2, 5), (2, 8), (2, 12), (2, 24), (3, 5))
"""Degrees of the polynomials to choose from, and the number of positions that each is fitted to."""
_JUDGED = 8
"""Newest positions that show which of the polynomials predicts best."""
_MOST = max(count for _, count in _FITS) + _JUDGED
"""Positions that are kept."""
_LONGEST_GAP = 20.0
"""Seconds after which a position does not continue the earlier ones."""
_SHARE = 0.25
"""Largest distance from the path of a position that continues it, relative to its step."""
_EARLY = 0.6
"""How much earlier or later it may be there than it came, in gaps."""
_SLACK = math.radians(0.1)
"""Distance that is always allowed, rad."""


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
        self._path = _path(times, points) if times else np.zeros((1, 3))
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
        # Positions may come late or early: the place on the path counts, not the time.
        around = time + self.gap * np.linspace(-_EARLY, _EARLY, 41)
        aside = float(np.min(np.linalg.norm(self.at(around) - point, axis=1)))
        step = math.dist(self._points[-1], point)
        return aside < _SHARE * step + _SLACK + 2.0 * self._rounding


def _path(times: Sequence[float], points: Sequence[Floats]) -> Floats:
    """Return the coefficients of time since the newest position, shape ``(degree + 1, 3)``."""
    since, rows = np.array(times) - times[-1], np.array(points)
    degree, count = min(len(rows) - 1, 1), len(rows)
    if len(rows) > 2:
        degree, count = min(_FITS, key=lambda fit: _miss(since, rows, *fit))
    return _fit(since[-count:], rows[-count:], degree)


def _miss(since: Floats, rows: Floats, degree: int, count: int) -> float:
    """Return the mean square error of the newest rows as predicted from the *count* before each.

    Infinite if there are too few rows.
    """
    misses = []
    for row in range(max(degree + 1, len(rows) - _JUDGED), len(rows)):
        used = slice(max(0, row - count), row)
        path = _fit(since[used] - since[row], rows[used], degree)
        # At time 0 the polynomial is its first coefficient.
        misses.append(np.sum((path[0] / np.linalg.norm(path[0]) - rows[row]) ** 2))
    return float(np.mean(misses)) if misses else math.inf


def _fit(since: Floats, rows: Floats, degree: int) -> Floats:
    """Return the coefficients of the polynomial that fits the rows best."""
    powers = np.vander(since, degree + 1, increasing=True)
    return np.asarray(np.linalg.lstsq(powers, rows, rcond=None)[0])
