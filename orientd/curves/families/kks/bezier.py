"""The Bezier quaternion curve of Kim, Kim and Shin, of any degree."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import CumulativeCurve, cumulative_basis
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_interval, increments


class KksBezier(CumulativeCurve):
    r"""Blend control quaternions with the cumulative Bernstein basis.

    .. math:: q(t) = q_0 \prod_{i=1}^n
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde\beta_{i,n}(u)\bigr), \quad
              \tilde\beta_{i,n}(u) = \sum_{j=i}^n \tbinom{n}{j} (1-u)^{n-j} u^j

    Kim, Kim and Shin (1995), eqs. (9) and (10).  The appendix prints the exponent ``n-i`` for
    ``n-j`` in the basis; the body of the paper has it right.  "Order n" there is degree n.

    Picture: ``orientd plot kks_bezier``.

    Args:
        control: at least two control quaternions, the first and last of which are met.
        t0: first instant, s.
        t1: last instant, s.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_bezier"
    summary = "one smooth segment drawn by control orientations"
    source = "Kim, Kim and Shin 1995, eq. (10)"
    takes = ("control", "t0", "t1", "align")

    @takes_common_names
    def __init__(
        self, *, control: ArrayLike, t0: float = 0.0, t1: float = 1.0, align: bool = True
    ) -> None:
        controls = check_aligned(control, align, "control")
        interval = check_interval(t0, t1)
        super().__init__(
            basis=cumulative_basis(np.repeat(interval, len(controls)), len(controls)),
            controls=controls,
            increments=increments(controls),
            continuity=2,
        )
