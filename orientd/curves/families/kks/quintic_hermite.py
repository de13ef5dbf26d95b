"""A quintic Hermite curve: orientation, velocity and acceleration prescribed at both ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    FRAMES,
    CumulativeCurve,
    check_ends,
    cumulative_basis,
    in_body_frame,
    turned,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import check_choice, check_interval
from orientd.rotation import between, exp_half, log_half, multiply, rotate


class KksQuinticHermite(CumulativeCurve):
    r"""Join two complete states of motion: orientation, angular velocity and acceleration.

    An extension of the cubic Hermite curve of Kim, Kim and Shin (1995), sec. 5.2, which they do
    not give: the cumulative Bernstein basis of degree 5, with

    .. math::
        q(t) &= q_0 \prod_{i=1}^5 \exp(w_i \tilde\beta_{i,5}(u)), \\
        w_1 &= \tfrac{h}{10} \Omega_0, \quad w_2 = w_1 + \tfrac{h^2}{40} \alpha_0, \\
        w_5 &= \tfrac{h}{10} \Omega_1, \quad
        w_4 = R(\exp w_5) \bigl(w_5 - \tfrac{h^2}{40} \alpha_1\bigr), \\
        w_3 &= \log\bigl(\exp(-w_2) \exp(-w_1) q_0^{-1} q_1 \exp(-w_5) \exp(-w_4)\bigr).

    At the start only :math:`\tilde\beta_1' = 5/h` and :math:`\tilde\beta_2'' = -\tilde\beta_1'' =
    20/h^2` differ from zero, so velocity and acceleration there are :math:`2 (5/h) w_1` and
    :math:`2 (20/h^2) (w_2 - w_1)`; at the end the same holds of the last two factors, with the
    turn of the last one between them.

    Picture: ``orientd plot kks_quintic_hermite``.

    Args:
        q0: first orientation.
        q1: last orientation.
        omega0: angular velocity at *t0*, rad/s, in *frame*.
        omega1: angular velocity at *t1*, rad/s, in *frame*.
        alpha0: angular acceleration at *t0*, rad/s^2, in *frame*.
        alpha1: angular acceleration at *t1*, rad/s^2, in *frame*.
        t0: first instant, s.
        t1: last instant, s.
        frame: ``"body"`` or ``"world"``: what velocities and accelerations are given in.
        revolutions: whole turns added about the axis of the middle factor; ``"least"`` scans for
            the number of least effort.
        align: whether *q1* takes the sign nearer to *q0*.

    Raises:
        ValueError: a parameter is not as said, or *revolutions* has no axis to turn about.
    """

    name = "kks_quintic_hermite"
    summary = "two orientations with velocities and accelerations at both ends"
    source = "extension of Kim, Kim and Shin 1995, sec. 5.2"
    interpolates = True
    meets_end_velocities = True
    meets_end_accelerations = True
    takes = (
        "q0",
        "q1",
        "omega0",
        "omega1",
        "alpha0",
        "alpha1",
        "t0",
        "t1",
        "frame",
        "revolutions",
        "align",
    )

    @takes_common_names
    def __init__(
        self,
        *,
        q0: ArrayLike,
        q1: ArrayLike,
        omega0: ArrayLike,
        omega1: ArrayLike,
        alpha0: ArrayLike = (0.0, 0.0, 0.0),
        alpha1: ArrayLike = (0.0, 0.0, 0.0),
        t0: float = 0.0,
        t1: float = 1.0,
        frame: str = "body",
        revolutions: int | str = 0,
        align: bool = True,
    ) -> None:
        start, end = check_ends(q0, q1, align=align)
        interval = check_interval(t0, t1)
        frame = check_choice(frame, "frame", FRAMES)
        h = interval[1] - interval[0]
        first = h / 10.0 * in_body_frame(omega0, "omega0", start, frame)
        second = first + h * h / 40.0 * in_body_frame(alpha0, "alpha0", start, frame)
        fifth = h / 10.0 * in_body_frame(omega1, "omega1", end, frame)
        towards_end = fifth - h * h / 40.0 * in_body_frame(alpha1, "alpha1", end, frame)
        fourth = rotate(exp_half(fifth), towards_end)
        middle = between(start, end)
        for outer in (first, second):
            middle = multiply(exp_half(-outer), middle)
        for outer in (fifth, fourth):
            middle = multiply(middle, exp_half(-outer))
        increments = np.stack([first, second, log_half(middle), fourth, fifth])
        basis = cumulative_basis(np.repeat(interval, 6), 6)
        super().__init__(
            basis=basis,
            controls=start[None],
            increments=turned(increments, revolutions, basis, start),
            continuity=2,
        )
