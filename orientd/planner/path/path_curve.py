"""Segments of a path laid end to end, as a curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.curves import Curve
from orientd.planner.path.path import PathSegment
from orientd.rotation import Floats


class PathCurve(Curve):
    """The curve of a path from its beginning on.

    Args:
        segments: end to end from path time 0 on, signs and two derivatives continuous.
    """

    def __init__(self, segments: Sequence[PathSegment]) -> None:
        knots = [np.array([0.0])]
        for one in segments:
            begin, end = one.begin, one.end
            origin = one.curve.domain[0] if one.rate > 0.0 else one.curve.domain[1]
            inner = np.sort((one.curve.knots - origin) / one.rate) - one.skipped + begin
            knots += [inner[(inner > begin) & (inner < end)], np.array([end])]
        super().__init__(knots=_apart(np.concatenate(knots)), continuity=2)
        self._laid = tuple(segments)

    def _sample(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        begins = [one.begin for one in self._laid[1:]]
        owner = np.searchsorted(begins, times, side="right")
        rows: Floats = np.empty((len(times), 10))
        for index, one in enumerate(self._laid):
            mine = owner == index
            if mine.any():
                rows[mine] = np.concatenate(one.sample(times[mine]), axis=1)
        return rows[:, :4], rows[:, 4:7], rows[:, 7:]


def _apart(knots: Floats) -> Floats:
    """Return knots without those that are another one but for rounding."""
    near = 1e-9 * float(knots[-1])
    kept = np.concatenate([[True], np.diff(knots) > near])
    kept[-1] = True
    if len(knots) > 2 and knots[-1] - knots[-2] <= near:
        kept[-2] = False
    apart: Floats = knots[kept]
    return apart
