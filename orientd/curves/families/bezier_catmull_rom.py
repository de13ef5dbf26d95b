"""Nielson's Catmull-Rom-like Bezier spline: inner points at 1/6 of the step across a keyframe."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import TriangleCurve, bezier_continuity, cubic_bezier_points, reflect
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_choice, resolve_times
from orientd.rotation import conjugate, multiply, slerp


class BezierCatmullRom(TriangleCurve):
    r"""Join keyframes by cubic slerp segments with inner points a sixth of the step across.

    .. math:: R_i = G[q_i,\; q_{i+1} q_{i-1}^{-1} q_i](1/6), \quad
              L_i = G[q_i,\; q_{i-1} q_{i+1}^{-1} q_i](1/6)

    Nielson (1993), sec. 2.2, whose second line defines :math:`L_{i+1}`, though it is printed as
    :math:`L_i`.  The ends have phantom neighbours :math:`q_0 q_1^{-1} q_0`.  Nielson reports that
    this is Schlag's Catmull-Rom curve; it is so for rotations about one axis only, otherwise the
    two differ (2.5 degrees at steps of 45, 31 at steps of 135).

    First derivatives agree at the keyframes for equal intervals only; otherwise directions do.

    Picture: ``orientd plot bezier_catmull_rom``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        order: ``"hamilton"`` as above, ``"reversed"`` with the products in the other order
            (:math:`q_i q_{i-1}^{-1} q_{i+1}`), which is another curve.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "bezier_catmull_rom"
    summary = "cubic slerp segments, tangents from central differences"
    source = "Nielson 1993, sec. 2.2"
    interpolates = True
    local = True
    takes = ("keys", "times", "order", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        order: str = "hamilton",
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        is_reversed = check_choice(order, "order", ("hamilton", "reversed")) == "reversed"
        padded = np.concatenate([reflect(q[1:2], q[:1]), q, reflect(q[-2:-1], q[-1:])])
        before, here, after = padded[:-2], padded[1:-1], padded[2:]
        if is_reversed:
            ahead = multiply(here, multiply(conjugate(before), after))
        else:
            ahead = multiply(after, multiply(conjugate(before), here))
        # L_i is R_i reflected.  Said so, both lie on one arc where keyframes half a turn apart
        # leave open which way round it goes.
        super().__init__(
            knots=instants,
            points=cubic_bezier_points(
                q, slerp(here, ahead, 1.0 / 6.0)[:-1], slerp(here, ahead, -1.0 / 6.0)[1:]
            ),
            continuity=bezier_continuity(instants),
        )
