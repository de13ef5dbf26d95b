"""The normalised nu-spline: a cubic spline in four dimensions with tension at the keyframes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import NormalizedSpline
from orientd.curves.keyframes import check_aligned, resolve_times
from orientd.rotation import Floats


class NuSpline(NormalizedSpline):
    r"""Interpolate quaternions by a cubic spline with tension, made unit.

    .. math:: \min \int \|c''\|^2 dt + \sum_i \nu_i \|c'(t_i)\|^2, \qquad q = c / \|c\|

    Nielson (1986; 1993, sec. 2.2).  Tension slows the curve at its keyframe and pulls kinks out.
    The acceleration jumps there by :math:`\nu_i` times the velocity, along it: the path has
    continuous curvature (G2) while the motion is C1; without tension it is C2.

    Picture: ``orientd plot nu_spline``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        nu: tension, not negative, in 1/s: one number, or one for each keyframe, the ends
            included.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "nu_spline"
    summary = "normalised cubic spline with tension at the keyframes"
    source = "Nielson 1986; Nielson 1993, sec. 2.2"
    interpolates = True

    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        nu: float | ArrayLike = 0.0,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        tension = check_tension(nu, len(q))
        super().__init__(
            keys=q,
            instants=resolve_times(times, q),
            tension=tension,
            continuity=1 if np.any(tension[1:-1] > 0.0) else 2,
        )


def check_tension(nu: object, count: int) -> Floats:
    """Return a tension for each of *count* keyframes.

    Raises:
        ValueError: *nu* is neither one number nor one for each keyframe, or one is negative or
            not finite.
    """
    expected = f"a number or one for each of the {count} keyframes, not negative"
    try:
        array = np.asarray(nu)
    except ValueError as error:
        raise ValueError(f"nu must be {expected}, got {nu!r}") from error
    if array.dtype.kind not in "iuf" or array.shape not in ((), (count,)):
        raise ValueError(f"nu must be {expected}, got {nu!r}")
    tension: Floats = np.full(count, array, dtype=np.float64)
    if not np.all(np.isfinite(tension) & (tension >= 0.0)):
        raise ValueError(f"nu must be {expected}, got {nu!r}")
    return tension
