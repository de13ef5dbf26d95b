"""Hermite quaternion segments joined at keyframes, with velocities estimated or given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import RULES, CumulativeCurve, cumulative_basis, half_velocities
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_aligned, check_choice, check_vector, resolve_times
from orientd.rotation import Floats, between, exp_half, log_half, multiply


class KksHermiteSpline(CumulativeCurve):
    r"""Join keyframes by Hermite segments, each meeting the velocities at its ends.

    .. math:: q(t) = q_i \exp\bigl(w_1 \tilde\beta_1(u)\bigr)
              \exp\bigl(w_2 \tilde\beta_2(u)\bigr) \exp\bigl(w_3 \tilde\beta_3(u)\bigr),
              \quad u = (t - t_i) / h

    Each segment is the curve of Kim, Kim and Shin (1995), sec. 5.2, with
    :math:`w_1 = h v_i / 3`, :math:`w_3 = h v_{i+1} / 3`, where :math:`v_i` is half the angular
    velocity at keyframe *i*, which the paper leaves open; *rule* names the estimate
    (:func:`orientd.curves.construct.velocities.half_velocities`).

    Picture: ``orientd plot kks_hermite_spline``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        rule: ``"parabola"``, ``"mean"`` or ``"chord"``.
        omega_start: body angular velocity at the first keyframe, rad/s, instead of the estimate.
        omega_end: body angular velocity at the last keyframe, rad/s, instead of the estimate.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "kks_hermite_spline"
    summary = "local C1 interpolation, end velocities met"
    source = "Kim, Kim and Shin 1995, sec. 5.2"
    interpolates = True
    local = True
    meets_end_velocities = True
    takes = ("keys", "times", "rule", "omega_start", "omega_end", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        rule: str = "parabola",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        aligned = check_aligned(keys, align)
        instants = resolve_times(times, aligned)
        rates = half_velocities(aligned, instants, check_choice(rule, "rule", RULES))
        if omega_start is not None:
            rates[0] = 0.5 * check_vector(omega_start, "omega_start")
        if omega_end is not None:
            rates[-1] = 0.5 * check_vector(omega_end, "omega_end")
        thirds = np.diff(instants)[:, None] / 3.0
        first, last = thirds * rates[:-1], thirds * rates[1:]
        leaving = multiply(aligned[:-1], exp_half(first))
        arriving = multiply(aligned[1:], exp_half(-last))
        middle = multiply(
            multiply(exp_half(-first), between(aligned[:-1], aligned[1:])), exp_half(-last)
        )
        controls: Floats = np.empty((3 * len(first) + 1, 4))
        controls[::3], controls[1::3], controls[2::3] = aligned, leaving, arriving
        super().__init__(
            basis=cumulative_basis(
                np.concatenate([instants[:1], np.repeat(instants, 3), instants[-1:]]), 4
            ),
            controls=controls,
            increments=np.stack([first, log_half(middle), last], axis=1).reshape(-1, 3),
            continuity=1,
        )
