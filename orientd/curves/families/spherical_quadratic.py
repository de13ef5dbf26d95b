"""Nielson's spherical quadratic B-spline: arcs over three points, joined at shoulder points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import ShoulderChain, TriangleCurve
from orientd.curves.contract import takes_common_names
from orientd.curves.families.nielson_shieh import check_criterion
from orientd.curves.keyframes import check_aligned, check_quaternion, resolve_times
from orientd.rotation import Floats, conjugate, log_half, multiply, slerp


class SphericalQuadratic(TriangleCurve):
    r"""Join keyframes by quadratic slerp segments, each over its own shoulder point.

    .. math:: B[q_i, M_i, q_{i+1}](t), \qquad
              M_{i+1} = G[M_i, q_{i+1}](1 + h_{i+1}/h_i)

    Nielson (1993), eqs. 18 to 21, for equal intervals: there the factor is 2.  So the first
    shoulder point decides the whole curve.  Without one it is searched for by

    * criterion 20, least length of the polygon :math:`q_1, M_1, M_2, \ldots, q_n`, or
    * criterion 21, least sum of squared distances of the segments' middles from their shoulders,

    with geodesic distances.  As printed, both minimise inner products, which drives the points
    apart (the integral of squared acceleration comes out 15 and 46 times as large); (19) runs to
    *n* and (20) sums to *n - 1*, each one too far.  Both criteria have several local minima; the
    search takes the best it finds from a fixed set of starts, in time proportional to the number of
    keyframes, some 4 ms each.

    The velocity is continuous at the keyframes.  Where an extrapolated arc is longer than pi it
    wraps around the sphere and the velocity jumps; :attr:`continuity` is then 0.

    Picture: ``orientd plot spherical_quadratic``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        M1: the first shoulder point, a unit quaternion; the sign nearer to the first keyframes is
            taken if *align*.
        criterion: 20 or 21, for the search.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "spherical_quadratic"
    summary = "quadratic slerp segments through shoulder points"
    source = "Nielson 1993, eqs. 18 to 21"
    interpolates = True
    takes = ("keys", "times", "M1", "criterion", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        M1: ArrayLike | None = None,  # noqa: N803 - the paper's name, in every motion file
        criterion: int = 21,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        check_criterion(criterion, (20, 21))
        h = np.diff(instants)
        if M1 is None:
            first = ShoulderChain(q, h[1:] / h[:-1], criterion).best_first()
        else:
            first = check_quaternion(M1, "M1")
            if align and float(first @ (q[0] + q[1])) < 0.0:
                first = -first
        shoulders, longest = shoulder_points(first, q, h)
        super().__init__(
            knots=instants,
            points=np.stack([q[:-1], shoulders, q[1:]], axis=1),
            continuity=2 if len(q) == 2 else 1 if longest < np.pi else 0,
        )

    @property
    def shoulders(self) -> Floats:
        """Shoulder points, shape ``(n - 1, 4)``."""
        points: Floats = self._points[:, 1].copy()
        return points


def shoulder_points(first: Floats, q: Floats, h: Floats) -> tuple[Floats, float]:
    """Return all shoulder points, and the length of the longest arc from a keyframe to the next.

    Args:
        first: the first one.
        q: keyframes, shape ``(n, 4)``.
        h: intervals, shape ``(n - 1,)``.
    """
    points = np.empty((len(h), 4))
    points[0] = first
    longest = 0.0
    for i in range(1, len(h)):
        ratio = h[i] / h[i - 1]
        points[i] = slerp(points[i - 1], q[i], 1.0 + ratio)
        arc = float(np.linalg.norm(log_half(multiply(conjugate(points[i - 1]), q[i]))))
        longest = max(longest, ratio * arc)
    return points, longest
