"""The normalised cubic spline: a natural spline of the four components, divided by its length."""

from __future__ import annotations

from numpy.typing import ArrayLike

from orientd.curves.contract import takes_common_names
from orientd.curves.families.nu_spline import NuSpline


class NormalizedCubic(NuSpline):
    r"""Interpolate quaternions by the natural cubic spline in four dimensions, made unit.

    .. math:: q(t) = c(t) / \|c(t)\|

    Nielson (1993), sec. 2.2.  C2 unless *c* passes through zero; cusps and tight kinks appear
    where it passes near, which takes steps of nearly half the sphere.  The course notes call the
    spline of least :math:`\int \|c''\|^2` the complete one; without prescribed end slopes it is
    the natural one.

    Picture: ``orientd plot normalized_cubic``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "normalized_cubic"
    summary = "natural cubic spline of the components, normalised"
    source = "Nielson 1993, sec. 2.2"
    takes = ("keys", "times", "align")

    @takes_common_names
    def __init__(
        self, *, keys: ArrayLike, times: str | ArrayLike | None = None, align: bool = True
    ) -> None:
        super().__init__(keys=keys, times=times, align=align)
