"""The Hermite quaternion curve of Kim, Kim and Shin: orientations and velocities at both ends."""

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

PRODUCTS = ("local", "global")


class KksHermite(CumulativeCurve):
    r"""Join two orientations with prescribed angular velocities at both ends.

    .. math::
        q(t) &= q_0 \exp(w_1 \tilde\beta_1) \exp(w_2 \tilde\beta_2) \exp(w_3 \tilde\beta_3) \\
        w_1 &= h \Omega_0 / 6, \quad w_3 = h \Omega_1 / 6, \quad
        w_2 = \log\bigl(\exp(w_1)^{-1} q_0^{-1} q_1 \exp(w_3)^{-1}\bigr)

    Kim, Kim and Shin (1995), sec. 5.2.  Their velocities are half the physical ones over a unit
    interval, hence :math:`h/6`.  The appendix forgets to invert :math:`\exp(w_3)` and uses
    :math:`w_3` before it is set; the body of the paper has it right.

    The paper calls the global frame "simply notational".  That is so for velocities given in the
    world frame, which *frame* converts.  Reversing the order of the product is another matter: it
    gives a different curve with the same end conditions, which *product* ``"global"`` selects.

    Picture: ``orientd plot kks_hermite``.

    Args:
        q0: first orientation.
        q1: last orientation.
        omega0: angular velocity at *t0*, rad/s, in *frame*.
        omega1: angular velocity at *t1*, rad/s, in *frame*.
        t0: first instant, s.
        t1: last instant, s.
        frame: ``"body"`` or ``"world"``: what the velocities are given in.
        revolutions: whole turns added about the axis of the middle factor; fast ends call for
            some, or the curve has to wind back; ``"least"`` scans for the number of least effort.
        product: ``"local"``, body increments multiplied from the right, or ``"global"``, world
            increments multiplied from the left.
        align: whether *q1* takes the sign nearer to *q0*.

    Raises:
        ValueError: a parameter is not as said, or *revolutions* has no axis to turn about.
    """

    name = "kks_hermite"
    summary = "two orientations with angular velocities at both ends"
    source = "Kim, Kim and Shin 1995, sec. 5.2"
    interpolates = True
    meets_end_velocities = True
    takes = (
        "q0",
        "q1",
        "omega0",
        "omega1",
        "t0",
        "t1",
        "frame",
        "revolutions",
        "product",
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
        t0: float = 0.0,
        t1: float = 1.0,
        frame: str = "body",
        revolutions: int | str = 0,
        product: str = "local",
        align: bool = True,
    ) -> None:
        start, end = check_ends(q0, q1, align=align)
        interval = check_interval(t0, t1)
        frame = check_choice(frame, "frame", FRAMES)
        sixth = (interval[1] - interval[0]) / 6.0
        first = sixth * in_body_frame(omega0, "omega0", start, frame)
        third = sixth * in_body_frame(omega1, "omega1", end, frame)
        relative = between(start, end)
        is_global = check_choice(product, "product", PRODUCTS) == "global"
        if is_global:
            # Conjugating the world increments by q0 moves it to the left end of the product.
            towards = rotate(relative, third)
            first, third = towards, first
        middle = multiply(multiply(exp_half(-first), relative), exp_half(-third))
        basis = cumulative_basis(np.repeat(interval, 4), 4)
        if is_global:
            basis = basis.reversed()
        increments = np.stack([first, log_half(middle), third])
        super().__init__(
            basis=basis,
            controls=start[None],
            increments=turned(increments, revolutions, basis, start),
            continuity=2,
        )
