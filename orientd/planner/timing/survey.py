"""A quick look at a keyframe path: how much longer it should be, and where that is decided.

Finding the shortest duration takes several looks at the records of a motion.  A motion of hours has
millions of them, but only near its largest rates do they matter; these places are found from the
derivatives at a few instants of every piece of the curve, and the search looks at nothing else.
The certificate looks at everything in the end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orientd.kernels import look_at, put_factors, put_instants, put_spots
from orientd.planner.certify import CHUNK, OFF_GRID, limit_table
from orientd.planner.limits import Limits
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.timing import excess
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

PIECES = 64
"""That a curve of fewer pieces is cut into."""

SHARES = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])
"""Of a piece, where it is looked at."""

HOT = 0.97
"""Of the largest factor, where a spot begins."""

GAP = 256
"""Records that cost less than another call."""

MARGIN = 4
"""Records on either side of a spot."""

_SHORT = 4 * CHUNK  # records that are looked at as a whole where the shape may change
_LARGEST_STEP = 0.75 * OFF_GRID[1][1]  # of what a step over a period is taken for
_EVERYWHERE = np.array([[0.0, 1.0]])
_NO_ENDS = np.empty((0, 2))
_END_KEYFRAMES = 10  # to which the ends of a curve reach, whatever the duration


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Where a keyframe path comes nearest to its limits.

    Attributes:
        factor: by which it should take longer to just keep them, about.
        spots: parts of the duration where that is decided, from 0 to 1, in order, shape ``(m, 2)``.
        has_one_shape: whether the spots are the same at any duration.
        is_held: whether the device holds before the keyframe path and after it, where that is the
            same at any duration.
    """

    factor: float
    spots: Floats
    has_one_shape: bool = False
    is_held: tuple[bool, bool] | None = None

    @classmethod
    def of(
        cls,
        keyframe_path: KeyframePath,
        limits: Limits,
        period: float,
        *,
        has_one_shape: bool = False,
    ) -> Survey:
        """Return the survey of a keyframe path.

        Args:
            keyframe_path: to look at.
            limits: to keep.
            period: of the device, s.
            has_one_shape: whether another duration is the same curve at another rate.
        """
        is_held = keyframe_path.held_ends(limits)
        # Where the acceleration goes on from that of a hold the ends are as smooth as the rest.
        with_ends = not (has_one_shape and keyframe_path.continuity >= 2 and all(is_held))
        instants = _instants(keyframe_path)
        factors = _factors(keyframe_path, instants, limits, period)
        largest = float(factors.max())
        ends = _NO_ENDS
        if with_ends:
            reach = 0 if has_one_shape else min(_END_KEYFRAMES, len(keyframe_path.times) - 1)
            ends = np.array(
                [
                    [0.0, keyframe_path.times[reach]],
                    [keyframe_path.times[-1 - reach], keyframe_path.duration],
                ]
            )
        spots: Floats = np.empty((len(instants) + 2, 2))
        count = put_spots(instants, factors, HOT * largest, ends, spots)
        known = is_held if has_one_shape else None
        return cls(largest, spots[:count] / keyframe_path.duration, has_one_shape, known)

    def look(
        self, keyframe_path: KeyframePath, limits: Limits, period: float, *, everywhere: bool
    ) -> float:
        """Return by which factor a keyframe path should take longer, from its records.

        Args:
            keyframe_path: the surveyed one or one like it, of another duration.
            limits: to keep.
            period: of the device, s.
            everywhere: whether to look beyond the spots.
        """
        count = keyframe_path.record_count(period)
        is_short = count <= _SHORT and not self.has_one_shape
        spots = _EVERYWHERE if everywhere or is_short else self.spots
        ranges = _ranges(spots, count - 1)
        trajectory = keyframe_path.trajectory
        if not keyframe_path.positions.is_held:
            factor = max(
                _excess(keyframe_path, limits, period, first, last) for first, last in ranges
            )
        else:
            factor = look_at(
                np.array(ranges).reshape(-1),
                trajectory.breaks,
                trajectory.pieces,
                period,
                *(self.is_held or keyframe_path.held_ends(limits)),
                limit_table(limits),
                GUARD_TOLERANCE,
                *OFF_GRID[keyframe_path.continuity],
                keyframe_path.continuity >= 2,
            )
        if keyframe_path.continuity >= 2:
            return factor
        # What a step of the acceleration shows on the records changes with where it falls between
        # them; the search needs something that depends on the duration smoothly.
        return max(
            factor, float(_factors(keyframe_path, _instants(keyframe_path), limits, period).max())
        )


def _excess(
    keyframe_path: KeyframePath, limits: Limits, period: float, first: int, last: int
) -> float:
    """Return by which factor a keyframe path should take longer, from some of its records."""
    return excess(keyframe_path.peaks(period, limits, first, last), keyframe_path.continuity)


def _instants(keyframe_path: KeyframePath) -> Floats:
    """Return instants on either side of every break of the keyframe path and between them, s."""
    breaks = keyframe_path.trajectory.knots
    if not keyframe_path.positions.is_held:
        breaks = np.union1d(breaks, keyframe_path.positions.breaks)
    instants: Floats = np.empty(len(SHARES) * (len(breaks) + PIECES + 1))
    return instants[: put_instants(breaks, keyframe_path.duration, PIECES, SHARES, instants)]


def _factors(
    keyframe_path: KeyframePath, instants: Floats, limits: Limits, period: float
) -> Floats:
    """Return, instant by instant, by which factor the keyframe path should take longer."""
    factors: Floats = np.zeros(len(instants))
    step = 0.0 if keyframe_path.continuity >= 2 else _LARGEST_STEP
    for first in range(0, len(instants), CHUNK):
        # One more on either side, for differences.
        some = slice(max(first - 1, 0), first + CHUNK)
        times, found = instants[some], factors[some].copy()
        _, omega, alpha = keyframe_path.trajectory.sample(times)
        spins, bends = np.ascontiguousarray(omega.T), np.ascontiguousarray(alpha.T)
        put_factors(times, spins, bends, period, limit_table(limits), step, found)
        if not keyframe_path.positions.is_held:
            _, velocity = keyframe_path.positions.sample(times)
            elapsed = np.maximum(times[1:] - times[:-1], period)
            push = np.concatenate([[0.0], _norm(np.diff(velocity, axis=0)) / elapsed])
            found = np.maximum(found, _norm(velocity) / limits.linear_velocity)
            found = np.maximum(found, np.sqrt(push / limits.linear_acceleration))
        factors[some] = np.maximum(factors[some], found)
    return factors


def _norm(vectors: Floats) -> Floats:
    norm: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return norm


def _ranges(spots: Floats, final: int) -> list[tuple[int, int]]:
    """Return first and last record of every spot, neighbours joined."""
    ranges: list[tuple[int, int]] = []
    for begin, end in spots.tolist():
        first = max(math.floor(begin * final) - MARGIN, 0)
        last = min(math.ceil(end * final) + MARGIN, final)
        if ranges and first <= ranges[-1][1] + GAP:
            first, last = ranges[-1][0], max(last, ranges.pop()[1])
        ranges.append((first, last))
    return ranges
