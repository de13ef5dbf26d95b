"""The B-spline quaternion curve of Kim, Kim and Shin, of any order over any knots."""

from __future__ import annotations

from numpy.typing import ArrayLike

from orientd.curves.construct import (
    CumulativeCurve,
    cumulative_basis,
    inner_multiplicity,
    resolve_knots,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_integer, increments


class KksBspline(CumulativeCurve):
    r"""Blend control quaternions with the cumulative B-spline basis; control is local.

    .. math:: q(t) = q_{l-k+1} \prod_{i=l-k+2}^{l}
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde B_{i,k}(t)\bigr),
              \quad t_l \le t < t_{l+1}

    Kim, Kim and Shin (1995), sec. 5.3.  Moving control quaternion *l* changes the curve on
    :math:`[t_l, t_{l+k}]` only.  The text names the increments and control quaternions of the
    span form one index too low in places; the formula itself is right.  The appendix defines the
    curve outside the domain by a power of the first quaternion; that is not invariant under a
    change of the world frame, and instants there are refused.

    Picture: ``orientd plot kks_bspline``.

    Args:
        control: control quaternions, at least *order*.
        order: degree plus one, at least 2.
        knots: non-decreasing knots in seconds, ``len(control) + order`` of them, or ``None`` for
            knots one second apart with the domain starting at 0.
        align: whether each control quaternion takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_bspline"
    summary = "C2 blending with local control; does not meet its control orientations"
    source = "Kim, Kim and Shin 1995, sec. 5.3"
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
        order = check_integer(order, "order", minimum=2)
        controls = check_aligned(control, align, "control", minimum=order)
        vector = resolve_knots(knots, len(controls), order)
        repeated = inner_multiplicity(vector, order)
        super().__init__(
            basis=cumulative_basis(vector, order),
            controls=controls,
            increments=increments(controls),
            continuity=order - 1 - repeated if repeated else 2,
        )
