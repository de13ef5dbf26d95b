"""De Casteljau's construction with slerp: one Bezier segment of any degree on the sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import TriangleCurve
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_interval


class DeCasteljau(TriangleCurve):
    r"""Draw one spherical Bezier curve from the first control quaternion to the last.

    .. math:: s_i^k(t) = G[s_{i-1}^{k-1}, s_i^{k-1}](u), \quad u = (t - t_0)/(t_1 - t_0),
              \quad q(t) = s_n^n(t)

    Shoemake (1985); Nielson (1993), eq. 17, whose control points are numbered from 0.  The end
    rates are ``n log(s_0^-1 s_1)`` and ``n log(s_{n-1}^-1 s_n)``; Nielson prints the one at the
    end with the opposite sign.

    Picture: ``orientd plot de_casteljau``.

    Args:
        control: unit quaternions ``(w, x, y, z)``, at least two; the degree is one less.
        t0: first instant, s.
        t1: last instant, s.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "de_casteljau"
    summary = "one Bezier segment of any degree by repeated slerp"
    source = "Shoemake 1985; Nielson 1993, eq. 17; Schlag 1991"
    takes = ("control", "t0", "t1", "align")

    @takes_common_names
    def __init__(
        self, *, control: ArrayLike, t0: float = 0.0, t1: float = 1.0, align: bool = False
    ) -> None:
        points = check_aligned(control, align, "control")
        super().__init__(knots=np.array(check_interval(t0, t1)), points=points[None], continuity=2)
