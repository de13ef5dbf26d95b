"""Squad: spherical quadrangle interpolation, for any times."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    RULES,
    check_defined,
    geodesic,
    half_velocities,
    linear,
    rates,
    slerp,
)
from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.keyframes import check_aligned, check_choice, increments, resolve_times
from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply


class Squad(Curve):
    r"""Blend the arc between two keyframes with the arc between two inner points.

    .. math:: q(t) = \mathrm{slerp}\bigl(\mathrm{slerp}(q_i, q_{i+1}, u),\;
              \mathrm{slerp}(a_i^+, a_{i+1}^-, u),\; 2u(1-u)\bigr)

    .. math:: a_i^+ = q_i \exp\bigl((h_i v_i - L_i)/2\bigr), \quad
              a_i^- = q_i \exp\bigl((L_{i-1} - h_{i-1} v_i)/2\bigr), \quad
              L_i = \log(q_i^{-1} q_{i+1})

    Shoemake (1987); the course notes give the blend and leave the inner points open.  These make
    the half-angle velocity at keyframe *i* equal :math:`v_i` from both sides for any times.  For
    equal ones and the rule ``"parabola"`` they are the usual
    :math:`q_i \exp(-(\log q_i^{-1} q_{i+1} + \log q_i^{-1} q_{i-1})/4)`.  The acceleration jumps
    at the keyframes.  With very unequal intervals (ten to one at steps of 80 degrees) an exponent
    may pass pi; the velocity then jumps there too, and :attr:`continuity` is 0.

    Picture: ``orientd plot squad``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        rule: for the velocities at inner keyframes: of the ``"parabola"`` through three
            keyframes, the ``"mean"`` of the two rates (as numpy-quaternion has it), or the
            ``"chord"`` across the keyframe.  At the ends it is the rate of the end interval.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "squad"
    summary = "spherical quadrangle blend of two great arcs"
    source = "Shoemake 1987; inner points for unequal times by the velocities at the keyframes"
    interpolates = True
    local = True
    takes = ("keys", "times", "rule", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        rule: str = "parabola",
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        check_choice(rule, "rule", RULES)
        h = np.diff(instants)[:, None]
        steps = increments(q)
        v = half_velocities(q, instants, rule)
        ahead, behind = 0.5 * (h * v[:-1] - steps), 0.5 * (steps - h * v[1:])
        is_smooth = max(np.sum(ahead**2, axis=1).max(), np.sum(behind**2, axis=1).max()) < np.pi**2
        super().__init__(knots=instants, continuity=0 if not is_smooth else 1 if len(q) > 2 else 2)
        self._keys, self._steps, self._slopes = q, steps, 1.0 / h[:, 0]
        self._inner = multiply(q[:-1], exp_half(ahead))
        inner_end = multiply(q[1:], exp_half(behind))
        self._inner_steps = log_half(multiply(conjugate(self._inner), inner_end))

    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        slope = self._slopes[span]
        u = linear((times - self._knots[span]) * slope, slope)
        outer = geodesic(self._keys[span], self._steps[span], u)
        inner = geodesic(self._inner[span], self._inner_steps[span], u)
        q, omega_body, alpha_body = rates(slerp(outer, inner, (u - u * u).times(2.0)))
        check_defined(q, alpha_body, times)
        return q, omega_body, alpha_body
