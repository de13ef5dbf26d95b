"""Schlag's B-spline: de Boor's algorithm with slerp, any order, uniform knots or not."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    TriangleCurve,
    bspline_intervals,
    inner_multiplicity,
    resolve_knots,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_integer


class SchlagBSpline(TriangleCurve):
    r"""Approximate control quaternions by de Boor's triangle of slerps.

    .. math:: P_i^r(t) = \mathrm{slerp}\Bigl(P_{i-1}^{r-1}, P_i^{r-1},
              \frac{t - x_i}{x_{i+k-r} - x_i}\Bigr), \qquad q(t) = P_L^{k-1}(t)
              \text{ on } [x_L, x_{L+1})

    Schlag (1991).  The printed non-uniform cubic triangle has five of its six fractions: the
    first one of the base, :math:`(t - t_{q-2})/(t_{q+1} - t_{q-2})`, is missing, and the last
    control point is :math:`P_0`; in the uniform triangle *t* counts from the segment's start.
    Unlike in the plane the cubic is not C2: the acceleration jumps by 0.2 % of its size at steps
    of 45 degrees and by 2 % at 170 (Kim, Kim and Shin, 1995, say so without figures).

    Picture: ``orientd plot schlag_bspline``.

    Args:
        control: unit quaternions ``(w, x, y, z)``, at least *order*.
        order: *k*, one more than the degree, at least 2.
        knots: non-decreasing instants in seconds, *order* more than control quaternions; without
            them uniform ones that make the curve start at 0.  The domain is
            ``[knots[order - 1], knots[-order]]``.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "schlag_bspline"
    summary = "B-spline of any order by de Boor's triangle of slerps"
    source = "Schlag 1991, after de Boor 1972"
    local = True
    takes = ("control", "order", "knots", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        control: ArrayLike,
        order: int = 4,
        knots: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        size = check_integer(order, "order", minimum=2)
        points = check_aligned(control, align, "control", minimum=size)
        x = resolve_knots(knots, len(points), size)
        spans = np.arange(size - 1, len(points))
        spans = spans[x[spans + 1] > x[spans]]
        window = spans[:, None] + np.arange(1 - size, 1)[None, :]
        super().__init__(
            knots=np.append(x[spans], x[len(points)]),
            points=points[window],
            intervals=bspline_intervals(x, spans, size),
            continuity=2 if len(spans) == 1 else min(1, size - 1 - inner_multiplicity(x, size)),
        )
