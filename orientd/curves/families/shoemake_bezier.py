"""Shoemake's Bezier spline: inner points from bisected reflections of the neighbours."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import TriangleCurve, bezier_continuity, cubic_bezier_points
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import ParameterError, check_aligned, check_number, resolve_times
from orientd.errors import PlanError
from orientd.rotation import Floats, slerp


class ShoemakeBezier(TriangleCurve):
    r"""Join keyframes by cubic slerp segments whose inner points average the neighbours.

    .. math:: D_i = 2 (q_{i-1} \cdot q_i)\, q_i - q_{i-1}, \quad
              R_i = \frac{D_i + q_{i+1}}{\|D_i + q_{i+1}\|}, \quad
              \mathrm{out}_i = \mathrm{slerp}(q_i, R_i, s), \quad
              \mathrm{in}_i = \mathrm{slerp}(q_i, R_i, -s)

    Shoemake (1985).  The course notes print the reflection as ``2 (p.q) - q``; its first term
    needs the factor *q*.  They list the inner points as ``q_0, a_0, b_0, q_1``, but the
    construction puts ``b_n`` before ``q_n``; and leave those at both ends open, here on the arcs
    to the neighbours.  With *s* = 1, as printed there and by Nielson (1993), the speed at a
    keyframe is three times that of the neighbours; *s* = 1/3 is Shoemake's truncation and the
    default.

    First derivatives agree at the keyframes for equal intervals only; otherwise directions do.

    Picture: ``orientd plot shoemake_bezier``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        s: shortening of the arcs to the inner points, in ``(0, 1]``, a number or a fraction such
            as ``"1/3"``.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: a keyframe's neighbours are so placed that they have no bisector.
    """

    name = "shoemake_bezier"
    summary = "cubic slerp segments, tangents from bisected reflections"
    source = "Shoemake 1985; Nielson 1993, sec. 2.2"
    interpolates = True
    local = True
    takes = ("keys", "times", "s", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        s: float | str = "1/3",
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        share = check_share(s, "s")
        targets = bisected_reflections(q)
        super().__init__(
            knots=instants,
            points=cubic_bezier_points(
                q,
                np.concatenate([slerp(q[:1], q[1:2], share), slerp(q[1:-1], targets, share)]),
                np.concatenate([slerp(q[1:-1], targets, -share), slerp(q[-1:], q[-2:-1], share)]),
            ),
            continuity=bezier_continuity(instants),
        )


def bisected_reflections(q: Floats) -> Floats:
    """Return Shoemake's ``R_i`` of the inner keyframes, shape ``(n - 2, 4)``.

    Raises:
        PlanError: a reflection is opposite to the next keyframe.
    """
    before, here, after = q[:-2], q[1:-1], q[2:]
    doubled = 2.0 * np.sum(before * here, axis=-1, keepdims=True) * here - before
    total = doubled + after
    length = np.sqrt(np.sum(total * total, axis=-1, keepdims=True))
    if not np.all(length > 1e-14):
        place = 1 + int(np.argmin(length))
        raise PlanError(
            f"keys[{place - 1}] to keys[{place + 1}] are a whole turn apart across "
            f"keys[{place}]: the bisector of Shoemake's construction is not defined"
        )
    bisected: Floats = total / length
    return bisected


def check_share(value: object, name: str) -> float:
    """Return a number in ``(0, 1]``, given as a number or as a fraction in words.

    Raises:
        ValueError: it is not one.
    """
    number: object = value
    if isinstance(value, str):
        try:
            number = float(Fraction(value))
        except (ValueError, ZeroDivisionError) as error:
            raise ParameterError(
                name, f"{name} must be a number or a fraction, got {value!r}"
            ) from error
    share = check_number(number, name)
    if not 0.0 < share <= 1.0:
        raise ParameterError(name, f"{name} must be greater than 0 and at most 1, got {value!r}")
    return share
