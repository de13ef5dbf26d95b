r"""The Barry-Goldman triangle with slerp, of which the slerp curves are different weights.

A point of the curve is at the top of a triangle whose base are the control quaternions of the
segment; every entry is the slerp of the two below it (Barry and Goldman, 1988; Schlag, 1991):

.. math:: P_j^r(t) = \mathrm{slerp}\Bigl(P_j^{r-1}(t),\; P_{j+1}^{r-1}(t),\;
          \frac{t - a_{r,j}}{b_{r,j} - a_{r,j}}\Bigr), \qquad P_j^0 = P_j

The intervals ``[a, b]`` alone make it a Bezier curve (:func:`bezier_intervals`: all are the
segment, which is the rule), a B-spline (:func:`bspline_intervals`: runs of knots that shorten
upwards) or a Catmull-Rom spline (:func:`catmull_rom_intervals`: runs that lengthen, then shorten).
Outside ``[a, b]`` the slerp extrapolates, as Catmull-Rom needs, and must not clamp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.curves.construct.jets import Jet, geodesic, linear, rates, slerp
from orientd.curves.contract import Curve, Samples
from orientd.errors import PlanError
from orientd.rotation import Floats, conjugate, log_half, multiply

Intervals = Sequence[tuple[Floats, Floats]]
"""For each level of the triangle from the base up, the starts and ends of the intervals of its
entries, shape ``(segments, entries)``."""


def bezier_intervals(knots: Floats, degree: int) -> Intervals:
    """Return the intervals that make the triangle de Casteljau's: the segment everywhere."""
    starts, ends = knots[:-1, None], knots[1:, None]
    return [
        (np.repeat(starts, count, axis=1), np.repeat(ends, count, axis=1))
        for count in range(degree, 0, -1)
    ]


def bspline_intervals(knots: Floats, spans: np.ndarray, order: int) -> Intervals:
    r"""Return the intervals of de Boor's algorithm.

    On the knot span ``[x_L, x_{L+1})`` entry *i* of level *r* blends over
    ``[x_i, x_{i+k-r}]``, ``i = L-k+1+r, ..., L`` (order *k*).  Schlag (1991) leaves one of the
    six fractions of the non-uniform cubic triangle out, the first of its base,
    ``(t - t_{q-2}) / (t_{q+1} - t_{q-2})``; this is the complete one.

    Args:
        knots: non-decreasing knots *x*.
        spans: the indices *L* of the knot spans, shape ``(segments,)``.
        order: *k*, one more than the degree.
    """
    levels = []
    for level in range(1, order):
        first = spans[:, None] + np.arange(level - order + 1, 1)[None, :]
        levels.append((knots[first], knots[first + order - level]))
    return levels


def catmull_rom_intervals(instants: Floats) -> Intervals:
    """Return the intervals of Barry and Goldman's cubic Catmull-Rom triangle.

    Args:
        instants: of the four keyframes a segment needs; it lies between the inner two, shape
            ``(segments, 4)``.
    """
    return [
        (instants[:, 0:3], instants[:, 1:4]),
        (instants[:, 0:2], instants[:, 2:4]),
        (instants[:, 1:2], instants[:, 2:3]),
    ]


class TriangleCurve(Curve):
    """A curve whose segments are slerp triangles, each over control quaternions of its own.

    Args:
        knots: where the segments begin, and the end, in seconds, shape ``(segments + 1,)``.
        points: control quaternions, shape ``(segments, order, 4)``.
        intervals: of the entries of the triangle; without them those of a Bezier curve.
        continuity: what holds at the knots.
    """

    def __init__(
        self,
        *,
        knots: Floats,
        points: Floats,
        intervals: Intervals | None = None,
        continuity: int,
    ) -> None:
        super().__init__(knots=knots, continuity=continuity)
        if intervals is None:
            intervals = bezier_intervals(knots, points.shape[1] - 1)
        self._points = points
        self._steps = log_half(multiply(conjugate(points[:, :-1]), points[:, 1:]))
        self._starts = [start for start, _ in intervals]
        self._slopes = [1.0 / (end - start) for start, end in intervals]

    def _sample(self, times: Floats) -> Samples:
        segments = self._segments(times)
        fractions = [self._fraction(level, segments, times) for level in range(len(self._starts))]
        points, steps = self._points[segments], self._steps[segments]
        entries = [geodesic(points[:, j], steps[:, j], u) for j, u in enumerate(fractions[0])]
        for row in fractions[1:]:
            entries = [slerp(entries[j], entries[j + 1], u) for j, u in enumerate(row)]
        q, omega_body, alpha_body = rates(entries[0])
        check_defined(q, alpha_body, times)
        return q, omega_body, alpha_body

    def _fraction(self, level: int, segments: np.ndarray, times: Floats) -> list[Jet]:
        starts, slopes = self._starts[level][segments], self._slopes[level][segments]
        return [
            linear((times - starts[:, j]) * slopes[:, j], slopes[:, j])
            for j in range(starts.shape[1])
        ]


def check_defined(q: Floats, alpha_body: Floats, times: Floats) -> None:
    """Refuse samples at which a construction of slerps passed through antipodal points.

    Raises:
        PlanError: a sample is not finite.
    """
    is_finite = np.isfinite(q).all(axis=-1) & np.isfinite(alpha_body).all(axis=-1)
    if not is_finite.all():
        instant = float(times[int(np.argmin(is_finite))])
        raise PlanError(
            f"the construction is not defined at t = {instant!r} s: "
            "a slerp joins antipodal quaternions there; put a keyframe in between"
        )


def cubic_bezier_points(keys: Floats, out_points: Floats, in_points: Floats) -> Floats:
    """Return the control quaternions of cubic segments between keyframes.

    Args:
        keys: keyframes, shape ``(n, 4)``.
        out_points: after keyframe *i*, ``i = 0 .. n-2``, shape ``(n - 1, 4)``.
        in_points: before keyframe *i*, ``i = 1 .. n-1``, shape ``(n - 1, 4)``.
    """
    return np.stack([keys[:-1], out_points, in_points, keys[1:]], axis=1)


def bezier_continuity(instants: Floats) -> int:
    """Return the continuity of cubic segments whose inner points are equally far from a keyframe.

    Velocities agree where two neighbouring intervals are equal; elsewhere directions do.
    """
    if len(instants) == 2:
        return 2
    intervals = np.diff(instants)
    return 1 if np.ptp(intervals) <= 1e-12 * intervals.max() else 0


def reflect(point: Floats, center: Floats) -> Floats:
    """Return the point as far beyond *center* as *point* is before it, ``c p^-1 c``."""
    return multiply(center, multiply(conjugate(point), center))
