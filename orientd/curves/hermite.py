"""Hermite curves of Kim, Kim and Shin (1995): states of motion at both ends, joined by products."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import (
    RULES,
    CumulativeBasis,
    cumulative_basis,
    half_velocities,
    squared_acceleration,
)
from orientd.curves.contract import takes_common_names
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_bool,
    check_choice,
    check_integer,
    check_interval,
    check_quaternion,
    check_vector,
    resolve_times,
)
from orientd.curves.products import Product
from orientd.rotation import Floats, between, conjugate, exp_half, log_half, multiply, rotate
from orientd.rotation import align as align_signs

PRODUCTS = ("local", "global")
FRAMES = ("body", "world")
LEAST = "least"


def check_ends(q0: ArrayLike, q1: ArrayLike, *, align: object) -> tuple[Floats, Floats]:
    """Return the first and the last orientation; with *align* the last near to the first in sign.

    Raises:
        ValueError: one of them is no unit quaternion, or *align* no bool.
    """
    ends = np.stack([check_quaternion(q0, "q0"), check_quaternion(q1, "q1")])
    start, end = align_signs(ends) if check_bool(align, "align") else ends
    return start, end


def in_body_frame(vector: ArrayLike, name: str, q: Floats, frame: str) -> Floats:
    """Return a checked vector, given in the body or world frame, in the body frame at *q*.

    An angular acceleration changes frame as an angular velocity does, since the velocity's own
    cross product with itself is zero.

    Raises:
        ValueError: the vector is not three finite numbers.
    """
    checked = check_vector(vector, name)
    return rotate(conjugate(q), checked) if frame == "world" else checked


def turned(
    increments: Floats, revolutions: object, basis: CumulativeBasis, start: Floats
) -> Floats:
    r"""Return increments whose middle one has whole turns added about its own axis.

    .. math:: w \, (1 + n \pi / \|w\|)

    Kim, Kim and Shin (1995), sec. 5.2.  An odd number ends at the negated quaternion, which is
    the same orientation.

    The best number is that of least effort, the integral of the squared angular acceleration; every
    one is tried that the outer increments could drive, up to :math:`\sum \|w_i\| / \pi + 2` either
    way.  No formula will do: rounding the middle increment to half of what the ends bring finds the
    best number in five cases of six at 5 rad/s over a second, and in one of ten at 50.

    Args:
        increments: half-angle vectors without whole turns, an odd number, shape ``(m, 3)``.
        revolutions: how many turns; ``"least"`` looks for the best number.
        basis: of the curve.
        start: its first orientation.

    Raises:
        ValueError: *revolutions* is neither, or turns are asked for and the middle increment, being
            zero, has no axis.
    """
    middle = len(increments) // 2
    length = float(np.linalg.norm(increments[middle]))

    def with_turns(count: int) -> Floats:
        changed = increments.copy()
        changed[middle] *= 1.0 + count * math.pi / length
        return changed

    if not isinstance(revolutions, str):
        given = check_integer(revolutions, "revolutions")
        if given and length == 0.0:
            raise ParameterError(
                "revolutions",
                "revolutions must be 0 when the middle increment of the curve is zero and so has "
                f"no axis, got {given}",
            )
        return with_turns(given) if given else increments
    if revolutions != LEAST:
        raise ParameterError(
            "revolutions", f"revolutions must be a whole number or {LEAST!r}, got {revolutions!r}"
        )
    if length == 0.0:
        return increments
    outer = np.delete(increments, middle, axis=0)
    most = math.ceil(float(np.sum(np.linalg.norm(outer, axis=-1))) / math.pi) + 2
    found, least = increments, math.inf
    # From few turns to many: of equals, the fewest.
    for count in sorted(range(-most, most + 1), key=abs):
        changed = with_turns(count)
        curve = Product(basis=basis, controls=start[None], increments=changed, continuity=2)
        effort = squared_acceleration(curve.evaluate, np.linspace(*curve.domain, 5 + 2 * most))
        if effort < least * (1.0 - 1e-9):
            found, least = changed, effort
    return found


class KksHermite(Product):
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
        omega_start = in_body_frame(omega0, "omega0", start, frame)
        omega_end = in_body_frame(omega1, "omega1", end, frame)
        first, third = sixth * omega_start, sixth * omega_end
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
            start=(omega_start, None),
            end=(omega_end, None),
        )


class KksQuinticHermite(Product):
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
        first_state = (
            in_body_frame(omega0, "omega0", start, frame),
            in_body_frame(alpha0, "alpha0", start, frame),
        )
        last_state = (
            in_body_frame(omega1, "omega1", end, frame),
            in_body_frame(alpha1, "alpha1", end, frame),
        )
        first = h / 10.0 * first_state[0]
        second = first + h * h / 40.0 * first_state[1]
        fifth = h / 10.0 * last_state[0]
        towards_end = fifth - h * h / 40.0 * last_state[1]
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
            start=first_state,
            end=last_state,
        )


class KksHermiteSpline(Product):
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
            start=(2.0 * rates[0], None),
            end=(2.0 * rates[-1], None),
        )
