"""What every curve on the rotation group promises: domain, knots, continuity, evaluation."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats

Samples = tuple[Floats, Floats, Floats]
"""Orientation ``(n, 4)``, body angular velocity ``(n, 3)`` in rad/s, its rate ``(n, 3)``."""

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""How far outside its domain, relative to the larger end, a curve still takes an instant."""

BLOCK = 8192
"""Samples worked out at a time; intermediate results of so many stay in the cache."""


class Curve(ABC):
    """A curve of orientations over an interval of time.

    A family subclasses this, computes what it needs in its constructor, whose keyword-only
    arguments are the family's parameters, and samples in :meth:`_sample`.

    Attributes:
        name: the key of the family in ``METHODS``.
        summary: one line for a list of the families.
        source: author, year and equation.
        interpolates: whether the curve passes through every keyframe at its time.
        local: whether moving a keyframe changes the curve near that keyframe only.
        meets_end_velocities: whether angular velocities can be prescribed at both ends.
        continuity: how many derivatives of the orientation are continuous at the knots for the
            parameters at hand: 0, 1 or 2.  A single segment has no knots inside and says 2.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    source: ClassVar[str]
    interpolates: ClassVar[bool] = False
    local: ClassVar[bool] = False
    meets_end_velocities: ClassVar[bool] = False

    continuity: int

    def __init__(self, *, knots: ArrayLike, continuity: int) -> None:
        """Set the break points of the curve, domain ends included, and its continuity there."""
        self._knots: Floats = np.array(knots, dtype=np.float64)
        self._knots.setflags(write=False)
        self._start = float(self._knots[0])
        self._end = float(self._knots[-1])
        self._slack = ROUNDING * max(abs(self._start), abs(self._end))
        self.continuity = min(continuity, 2)

    @property
    def knots(self) -> Floats:
        """The increasing instants, in seconds, at which the formula changes, and both ends."""
        return self._knots

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last instant, in seconds, at which the curve is defined."""
        return self._start, self._end

    def evaluate(self, times: ArrayLike, *, out: Floats | None = None) -> Samples:
        """Return orientation, body angular velocity and body angular acceleration.

        At a knot the values are those of the segment that begins there, at the end of the domain
        those of the last segment.

        Args:
            times: instants in seconds inside :attr:`domain`, any shape, in any order; increasing
                ones are quickest.
            out: a C-contiguous float64 array of shape ``(10, n)``, *n* the number of instants, to
                fill: four rows of orientation, three of angular velocity, three of angular
                acceleration.  The arrays returned are views of it.  Without it they are new.

        Returns:
            Quaternions ``(..., 4)`` scalar first, whose sign is continuous along the curve;
            angular velocity ``2 vec(q* q')`` in rad/s in the body frame, ``(..., 3)``; its rate
            in rad/s^2 in the body frame, ``(..., 3)``; leading axes as in *times*.

        Raises:
            ValueError: an instant is outside the domain (rounding apart) or not a number, or
                *out* does not fit.
        """
        instants = np.asarray(times, dtype=np.float64)
        flat = self._inside(instants.reshape(-1))
        if out is not None:
            check_out(out, flat.size)
        q, omega_body, alpha_body = self._sample_in_blocks(flat)
        if out is not None:
            out[0:4], out[4:7], out[7:10] = q.T, omega_body.T, alpha_body.T
            q, omega_body, alpha_body = out[0:4].T, out[4:7].T, out[7:10].T
        if instants.ndim == 1:
            return q, omega_body, alpha_body
        return in_shape(instants.shape, q, omega_body, alpha_body)

    def ends(self) -> Samples:
        """Return what :meth:`evaluate` does at both ends of the domain."""
        return self.evaluate(np.array(self.domain))

    def _sample_in_blocks(self, times: Floats) -> Samples:
        """Return the samples, worked out so many at a time that memory stays bounded."""
        if len(times) <= BLOCK:
            return self._sample(times)
        parts = [self._sample(times[k : k + BLOCK]) for k in range(0, len(times), BLOCK)]
        q, omega_body, alpha_body = (np.concatenate(part) for part in zip(*parts, strict=True))
        return q, omega_body, alpha_body

    @abstractmethod
    def _sample(self, times: Floats) -> Samples:
        """Return the samples at *times*, shape ``(n,)``, which are inside the domain."""

    def _inside(self, times: Floats) -> Floats:
        """Return *times* with rounding beyond the ends cut off, refusing more than that."""
        is_outside = ~((times >= self._start - self._slack) & (times <= self._end + self._slack))
        if is_outside.any():
            worst = float(times[int(np.argmax(is_outside))])
            raise ValueError(
                f"times must be in the domain [{self._start!r}, {self._end!r}] s, got {worst!r}"
            )
        clipped: Floats = np.clip(times, self._start, self._end)
        return clipped

    def _segments(self, times: Floats) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the index of the knot span of each instant, the last span closed at its end."""
        interior = self._knots[1:-1]
        spans: np.ndarray[tuple[int], np.dtype[np.intp]] = np.searchsorted(
            interior, times, side="right"
        )
        return spans


def in_shape(shape: tuple[int, ...], q: Floats, omega_body: Floats, alpha_body: Floats) -> Samples:
    """Return samples at a row of instants with the leading axes that the instants had."""
    return q.reshape(*shape, 4), omega_body.reshape(*shape, 3), alpha_body.reshape(*shape, 3)


def check_out(out: Floats, count: int) -> None:
    """Refuse a buffer that is not writable, C-contiguous float64 of shape ``(10, count)``.

    Raises:
        ValueError: it is not.
    """
    if out.shape != (10, count) or out.dtype != np.float64 or not out.flags.carray:
        raise ValueError(
            f"out must be a writable C-contiguous float64 array of shape (10, {count}), "
            f"got {out.dtype} of shape {out.shape}"
        )
