"""A path of cumulative products alone, as one row of numbers that the kernels sample it from.

The row begins with the number of segments, the path time from which on the path is held, and the
orientations before it and after it.  Of each segment follow when it begins, what is skipped of it,
its rate and its sign, then its clock and then its curve.  The clock is the number of its nodes, 0
where the curve runs on its own time, or that number, times, places, squared rates and slopes of the
nodes, two lengths over which it leaves rest, the curve's first instant and its seconds for a second
of the clock.  The curve is how many spans and factors it has, and what it is sampled from.  That is
breaks and table of cubic factors, for which the number of factors is given as 0, or breaks, base,
axes, lengths and the coefficients of the basis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from orientd.curves import CumulativeCurve, Curve, Retimed
from orientd.rotation import Floats

_NO_CLOCK = np.zeros(1)


class Segment(Protocol):
    """What a row says of a segment; see :class:`.PathSegment`."""

    @property
    def curve(self) -> Curve: ...  # noqa: D102
    @property
    def begin(self) -> float: ...  # noqa: D102
    @property
    def skipped(self) -> float: ...  # noqa: D102
    @property
    def rate(self) -> float: ...  # noqa: D102
    @property
    def sign(self) -> float: ...  # noqa: D102


def plain_curve(curve: Curve) -> Floats | None:
    """Return the part of the row that is a curve, if that is such a product."""
    if not isinstance(curve, CumulativeCurve):
        return None
    return np.concatenate([curve.spans_and_factors, *(part.reshape(-1) for part in curve.parts)])


def plain_path(
    segments: Sequence[Segment], first: Floats, last: Floats, end: float
) -> Floats | None:
    """Return the row of numbers that a path is sampled from, if its curves are such products.

    Args:
        segments: end to end.
        first: orientation before the path.
        last: orientation after it.
        end: path time from which on it is held, s.
    """
    parts: list[Floats] = [np.array([len(segments), end]), first, last]
    for segment in segments:
        inner, clock = segment.curve, _NO_CLOCK
        if isinstance(inner, Retimed):
            warp = inner.warp
            ends = (*warp.leaves.tolist(), warp.first, warp.scale)
            nodes = warp.times, warp.places, warp.values, warp.slopes
            clock = np.concatenate([[float(len(warp.times))], *nodes, ends])
            inner = inner.curve
        curve = plain_curve(inner)
        if curve is None:
            return None
        parts.append(np.array([segment.begin, segment.skipped, segment.rate, segment.sign]))
        parts += [clock, curve]
    return np.concatenate(parts)
