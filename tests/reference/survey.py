"""A quick look at a core: how much longer it should be, and where that is decided.

Finding the shortest duration takes several looks at the records of a motion.  A motion of hours has
millions of them, but only near its largest rates do they matter; these places are found from the
derivatives at a few instants of every piece of the curve, and the search looks at nothing else.
The certificate looks at everything in the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.cumulative import CumulativeCurve
from orientd.planner.course import Core
from orientd.planner.differences import OFF_GRID
from orientd.planner.fast import kernels
from orientd.planner.limit_table import limit_table
from orientd.planner.limits import Limits
from orientd.planner.measuring import CHUNK
from orientd.planner.timing import excess
from orientd.rotation import Floats

PIECES = 64
"""That a curve of fewer pieces is cut into."""

SHARES = (1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6)
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
_END_KEYFRAMES = 10  # to which the ends of a curve reach, whatever the duration


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Where a core comes nearest to its limits.

    Attributes:
        factor: by which it should take longer to just keep them, about.
        spots: parts of the duration where that is decided, from 0 to 1, in order, shape ``(m, 2)``.
        has_one_shape: whether the spots are the same at any duration.
        is_held: whether the device holds before the core and after it, where that is the same at
            any duration.
    """

    factor: float
    spots: Floats
    has_one_shape: bool = False
    is_held: tuple[bool, bool] | None = None

    @classmethod
    def of(
        cls, core: Core, limits: Limits, period: float, *, has_one_shape: bool = False
    ) -> Survey:
        """Return the survey of a core.

        Args:
            core: to look at.
            limits: to keep.
            period: of the device, s.
            has_one_shape: whether another duration is the same curve at another rate.
        """
        is_held = core.held_ends(limits)
        # Where the acceleration goes on from that of a hold the ends are as smooth as the rest.
        with_ends = not (has_one_shape and core.continuity >= 2 and all(is_held))
        terms, compiled = _terms(core, limits, period), kernels().survey
        if has_one_shape and terms is not None and compiled is not None:
            most = len(SHARES) * (len(core.stretch.curve.knots) + PIECES) + 2
            spots: Floats = np.empty((most, 2))
            factor, count = compiled(*terms, with_ends, spots)
            return cls(factor, spots[:count], has_one_shape, is_held)
        instants = _instants(core)
        factors = _factors(core, instants, limits, period)
        largest = float(factors.max())
        hot = np.flatnonzero(factors >= HOT * largest)
        begins = instants[np.maximum(hot - 1, 0)]
        ends = instants[np.minimum(hot + 1, len(instants) - 1)]
        if with_ends:
            reach = 0 if has_one_shape else min(_END_KEYFRAMES, len(core.times) - 1)
            begins = np.concatenate([[0.0, core.times[-1 - reach]], begins])
            ends = np.concatenate([[core.times[reach], core.duration], ends])
        return cls(largest, _merged(begins, ends) / core.duration, has_one_shape)

    def look(self, core: Core, limits: Limits, period: float, *, everywhere: bool) -> float:
        """Return by which factor a core should take longer, from its records.

        Args:
            core: the surveyed one or one like it, of another duration.
            limits: to keep.
            period: of the device, s.
            everywhere: whether to look beyond the spots.
        """
        count = core.record_count(period)
        is_short = count <= _SHORT and not self.has_one_shape
        spots = _EVERYWHERE if everywhere or is_short else self.spots
        terms, compiled = _terms(core, limits, period), kernels().look
        if terms is not None and compiled is not None:
            is_held = self.is_held or core.held_ends(limits)
            return compiled(spots, count - 1, *terms, *is_held)
        ranges = _ranges(spots, count)
        factor = max(_excess(core, limits, period, first, last) for first, last in ranges)
        if core.continuity >= 2:
            return factor
        # What a step of the acceleration shows on the records changes with where it falls between
        # them; the search needs something that depends on the duration smoothly.
        return max(factor, float(_factors(core, _instants(core), limits, period).max()))


def _terms(
    core: Core, limits: Limits, period: float
) -> tuple[Floats, Floats, float, float, float, Floats] | None:
    """Return a core as the compiled kernels know it; ``None`` where they cannot look at it."""
    stretch, curve = core.stretch, core.stretch.curve
    table = curve.table if isinstance(curve, CumulativeCurve) else None
    is_plain = core.positions.is_held and core.continuity >= 2 and stretch.rate > 0.0
    if table is None or not is_plain:
        return None
    return curve.knots, table, stretch.rate, core.duration, period, limit_table(limits)


def _excess(core: Core, limits: Limits, period: float, first: int, last: int) -> float:
    """Return by which factor a core should take longer, from some of its records."""
    return excess(core.peaks(period, limits, first, last), core.continuity)


def _instants(core: Core) -> Floats:
    """Return instants on either side of every break of the core and between them, s."""
    curve = core.stretch.curve
    breaks = (curve.knots - curve.domain[0]) / core.stretch.rate
    if not core.positions.is_held:
        breaks = np.union1d(breaks, core.positions.breaks)
    breaks = breaks[(breaks >= 0.0) & (breaks <= core.duration)]
    if len(breaks) < PIECES:
        breaks = np.union1d(breaks, np.linspace(0.0, core.duration, PIECES + 1))
    widths = np.diff(breaks)
    begins, widths = breaks[:-1][widths > 0.0], widths[widths > 0.0]
    instants: Floats = (begins[:, None] + widths[:, None] * np.array(SHARES)).reshape(-1)
    return instants


def _factors(core: Core, instants: Floats, limits: Limits, period: float) -> Floats:
    """Return, instant by instant, by which factor the core should take longer."""
    factors: Floats = np.zeros(len(instants))
    for first in range(0, len(instants), CHUNK):
        # One more on either side, for differences.
        some = slice(max(first - 1, 0), first + CHUNK)
        times = instants[some]
        _, omega, alpha = core.stretch.sample(times)
        # What lies within a period counts as a step of the acceleration over one.
        steps = np.maximum(times[1:] - times[:-1], period)
        twists = np.zeros(len(times))
        twists[1:] = _shares(alpha[1:] - alpha[:-1], limits, "jerk") / steps
        of_all = [
            factors[some],
            _shares(omega, limits, "velocity"),
            np.sqrt(_shares(alpha, limits, "acceleration")),
            np.sqrt(_LARGEST_STEP * twists) if core.continuity < 2 else np.cbrt(twists),
        ]
        if not core.positions.is_held:
            _, velocity = core.positions.sample(times)
            push = np.concatenate([[0.0], _norm(np.diff(velocity, axis=0)) / steps])
            of_all.append(_norm(velocity) / limits.linear_velocity)
            of_all.append(np.sqrt(push / limits.linear_acceleration))
        factors[some] = np.maximum.reduce(of_all)
    return factors


def _shares(vectors: Floats, limits: Limits, name: str) -> Floats:
    """Return angular rates as shares of their limits, of the norm or of an axis."""
    shares = _norm(vectors) / float(getattr(limits, name))
    if limits.has_axes:
        shares = np.maximum(shares, np.max(np.abs(vectors) / limits.axes(name), axis=-1))
    return shares


def _norm(vectors: Floats) -> Floats:
    norm: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return norm


def _merged(begins: Floats, ends: Floats) -> Floats:
    """Return the union of intervals, as intervals in order, shape ``(m, 2)``."""
    order = np.argsort(begins)
    begins, ends = begins[order], np.maximum.accumulate(ends[order])
    is_new = np.concatenate([[True], begins[1:] > ends[:-1]])
    firsts = np.flatnonzero(is_new)
    lasts = np.concatenate([firsts[1:] - 1, [len(begins) - 1]])
    return np.stack([begins[firsts], ends[lasts]], axis=-1)


def _ranges(spots: Floats, count: int) -> list[tuple[int, int]]:
    """Return first and last record of every spot, neighbours joined."""
    firsts = np.maximum(np.floor(spots[:, 0] * (count - 1)) - MARGIN, 0).astype(int)
    lasts = np.minimum(np.ceil(spots[:, 1] * (count - 1)) + MARGIN, count - 1).astype(int)
    ranges = [(int(firsts[0]), int(lasts[0]))]
    for first, last in zip(firsts[1:].tolist(), lasts[1:].tolist(), strict=True):
        if first <= ranges[-1][1] + GAP:
            ranges[-1] = ranges[-1][0], max(last, ranges[-1][1])
        else:
            ranges.append((first, last))
    return ranges
