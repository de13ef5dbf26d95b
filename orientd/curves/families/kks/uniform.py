"""The uniform cubic B-spline quaternion curve of Kim, Kim and Shin, with phantom end points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import CumulativeCurve, cumulative_basis
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_interval, check_number, increments
from orientd.rotation import conjugate, multiply


class KksUniform(CumulativeCurve):
    r"""Blend control quaternions at equal intervals, meeting the first and the last.

    .. math:: q(t) = q_{-1} \prod_{i=0}^{n+1}
              \exp\bigl(\log(q_{i-1}^{-1} q_i) \, \tilde B_{i,4}(t)\bigr)

    The cumulative cubic B-spline over the knots :math:`t_i = i - 2`, with phantom control
    quaternions :math:`q_{-1} = q_0 q_1^{-1} q_0` and :math:`q_{n+1} = q_n q_{n-1}^{-1} q_n`, on
    :math:`[0, n]` (Kim, Kim and Shin, 1995, appendix).  The appendix prints the second phantom as
    :math:`q_n q_n^{-1} q_n`, with which the curve misses :math:`q_n`.  Control quaternions inside
    are approached, not met.

    Picture: ``orientd plot kks_uniform``.

    Args:
        control: at least two control quaternions.
        t0: where the domain begins, s.
        t1: where it ends; ``None`` puts the control quaternions one second apart.
        align: whether each takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_uniform"
    summary = "C2 blending at one orientation a second, ends met"
    source = "Kim, Kim and Shin 1995, appendix"
    local = True
    takes = ("control", "t0", "t1", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        control: ArrayLike,
        t0: float = 0.0,
        t1: float | None = None,
        align: bool = True,
    ) -> None:
        inner = check_aligned(control, align, "control")
        before = multiply(multiply(inner[0], conjugate(inner[1])), inner[0])
        after = multiply(multiply(inner[-1], conjugate(inner[-2])), inner[-1])
        controls = np.concatenate([before[None], inner, after[None]])
        spans = len(inner) - 1
        start, end = check_interval(t0, check_number(t0, "t0") + spans if t1 is None else t1)
        knots = start + np.arange(-3.0, spans + 4.0) * ((end - start) / spans)
        knots[3 + spans] = end
        super().__init__(
            basis=cumulative_basis(knots, 4),
            controls=controls,
            increments=increments(controls),
            continuity=2,
        )
