"""Hermite curves of Kim, Kim and Shin (1995): products that join states of motion at both ends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import cumulative_basis
from orientd.curves.contract import NEEDED, Through
from orientd.curves.keyframes import (
    ParameterError,
    check_bool,
    check_choice,
    check_integer,
    check_interval,
    check_quaternion,
    check_vector,
    increments,
)
from orientd.curves.products import Parts, Product, product_trajectory, squared_acceleration
from orientd.rotation import Floats, between, conjugate, exp_half, log_half, multiply, rotate
from orientd.rotation import align as align_signs

PRODUCTS = ("local", "global")
FRAMES = ("body", "world")
RULES = ("parabola", "mean", "chord")
LEAST = "least"


class HermiteSegment(Product):
    """One segment with given states of motion at its ends; ``_solve`` gets body components."""

    interpolates = True
    meets_end_velocities = True
    shared: ClassVar[Mapping[str, Any]] = {
        **dict.fromkeys(("q0", "q1", "omega0", "omega1"), NEEDED),
        "t0": 0.0,
        "t1": 1.0,
        "frame": "body",
        "revolutions": 0,
        "align": True,
    }

    def _make(
        self,
        q0: object,
        q1: object,
        t0: object,
        t1: object,
        frame: object,
        align: object,
        **own: Any,  # noqa: ANN401 - of any family
    ) -> None:
        start, end = check_quaternion(q0, "q0"), check_quaternion(q1, "q1")
        if check_bool(align, "align"):
            start, end = align_signs(np.stack([start, end]))
        is_world = check_choice(frame, "frame", FRAMES) == "world"
        # An acceleration changes frame as a velocity does, because the velocity's cross product
        # with itself is zero.
        for name in ("omega0", "omega1", "alpha0", "alpha1"):
            if name in own:
                vector = check_vector(own[name], name)
                key = start if name.endswith("0") else end
                own[name] = rotate(conjugate(key), vector) if is_world else vector
        self._ends = (own["omega0"], own.get("alpha0")), (own["omega1"], own.get("alpha1"))
        self._solve(start, end, check_interval(t0, t1), **own)

    def _set_factors(
        self,
        start: Floats,
        interval: tuple[float, float],
        revolutions: object,
        vectors: Floats,
        *,
        is_reversed: bool = False,
    ) -> None:
        r"""Set up the product of *vectors*, the middle one with whole turns about its own axis.

        .. math:: w \, (1 + n \pi / \|w\|)

        Kim, Kim and Shin (1995), sec. 5.2.  An odd number ends at the negated quaternion, which is
        the same orientation.

        The best number has the least effort, the integral of the squared angular acceleration.  The
        search tries every number that the outer increments could drive, up to :math:`\sum \|w_i\| /
        \pi + 2` either way.  No simple formula is reliable.  Rounding the middle
        increment to half of the outer ones finds the best number in five of six cases at 5 rad/s
        over a second, but in one of ten at 50 rad/s.
        """
        order = len(vectors) + 1
        basis = cumulative_basis(np.repeat(interval, order), order)
        values = np.ascontiguousarray(basis.values[:, ::-1] if is_reversed else basis.values)
        middle, first = len(vectors) // 2, np.zeros(1, dtype=np.int64)
        length = float(np.linalg.norm(vectors[middle]))

        def parts(count: int) -> Parts:
            changed = vectors.copy()
            changed[middle] *= 1.0 + (count * math.pi / length if count else 0.0)
            return start[None], first, changed, values

        found = parts(0)
        if not isinstance(revolutions, str):
            given = check_integer(revolutions, "revolutions")
            if given and length == 0.0:
                raise ParameterError(
                    "revolutions",
                    "revolutions must be 0 when the middle increment of the curve is zero and so "
                    f"has no axis, got {given}",
                )
            found = parts(given)
        elif revolutions != LEAST:
            raise ParameterError(
                "revolutions",
                f"revolutions must be a whole number or {LEAST!r}, got {revolutions!r}",
            )
        elif length > 0.0:
            outer = np.delete(vectors, middle, axis=0)
            most = math.ceil(float(np.sum(np.linalg.norm(outer, axis=-1))) / math.pi) + 2
            times, least = np.linspace(*interval, 5 + 2 * most), math.inf
            # From few turns to many: among equals, the fewest.
            for count in sorted(range(-most, most + 1), key=abs):
                tried = parts(count)
                effort = squared_acceleration(product_trajectory(basis.breaks, tried).sample, times)
                if effort < least * (1.0 - 1e-9):
                    found, least = tried, effort
        self._set_parts(basis.breaks, found, 2)


class KksHermite(HermiteSegment):
    r"""Join two orientations with prescribed angular velocities at both ends.

    .. math::
        q(t) &= q_0 \exp(w_1 \tilde\beta_1) \exp(w_2 \tilde\beta_2) \exp(w_3 \tilde\beta_3) \\
        w_1 &= h \Omega_0 / 6, \quad w_3 = h \Omega_1 / 6, \quad
        w_2 = \log\bigl(\exp(w_1)^{-1} q_0^{-1} q_1 \exp(w_3)^{-1}\bigr)

    Kim, Kim and Shin (1995), sec. 5.2.  Their velocities are half the physical ones over a unit
    interval, hence :math:`h/6`.  The appendix omits the inverse of :math:`\exp(w_3)` and uses
    :math:`w_3` before it is set; the body of the paper has it right.

    The paper calls the global frame "simply notational".  That holds for velocities in the world
    frame, which *frame* converts.  Reversing the order of the product is different: it gives
    another curve with the same end conditions, which *product* ``"global"`` selects.

    Picture: ``orientd plot kks_hermite``.

    Args:
        revolutions: whole turns added about the axis of the middle factor.  Fast ends need some, or
            the curve has to wind back.  ``"least"`` finds the number of least effort.
        product: ``"local"``, body increments multiplied from the right, or ``"global"``, world
            increments multiplied from the left.
        align: whether *q1* takes the sign nearer to *q0*.
    """

    name = "kks_hermite"
    summary = "two orientations with angular velocities at both ends"
    source = "Kim, Kim and Shin 1995, sec. 5.2"
    own: ClassVar[Mapping[str, Any]] = {"product": "local"}

    def _solve(
        self,
        start: Floats,
        end: Floats,
        interval: tuple[float, float],
        omega0: Floats,
        omega1: Floats,
        revolutions: object,
        *,
        product: str,
    ) -> None:
        sixth = (interval[1] - interval[0]) / 6.0
        first, third = sixth * omega0, sixth * omega1
        relative = between(start, end)
        is_global = check_choice(product, "product", PRODUCTS) == "global"
        if is_global:
            # Conjugating the world increments by q0 moves it to the left end of the product.
            first, third = rotate(relative, third), first
        middle = multiply(multiply(exp_half(-first), relative), exp_half(-third))
        vectors = np.stack([first, log_half(middle), third])
        self._set_factors(start, interval, revolutions, vectors, is_reversed=is_global)


class KksQuinticHermite(HermiteSegment):
    r"""Join two complete states of motion: orientation, angular velocity and acceleration.

    An extension of the cubic Hermite curve of Kim, Kim and Shin (1995), sec. 5.2, which the paper
    does not have: the cumulative Bernstein basis of degree 5, with

    .. math::
        q(t) &= q_0 \prod_{i=1}^5 \exp(w_i \tilde\beta_{i,5}(u)), \\
        w_1 &= \tfrac{h}{10} \Omega_0, \quad w_2 = w_1 + \tfrac{h^2}{40} \alpha_0, \\
        w_5 &= \tfrac{h}{10} \Omega_1, \quad
        w_4 = R(\exp w_5) \bigl(w_5 - \tfrac{h^2}{40} \alpha_1\bigr), \\
        w_3 &= \log\bigl(\exp(-w_2) \exp(-w_1) q_0^{-1} q_1 \exp(-w_5) \exp(-w_4)\bigr).

    At the start only :math:`\tilde\beta_1' = 5/h` and :math:`\tilde\beta_2'' = -\tilde\beta_1'' =
    20/h^2` differ from zero.  So velocity and acceleration there are :math:`2 (5/h) w_1` and
    :math:`2 (20/h^2) (w_2 - w_1)`.  The same holds at the end for the last two factors, with the
    turn of the last one between them.

    Picture: ``orientd plot kks_quintic_hermite``.

    Args:
        alpha0: angular acceleration at *t0*, rad/s^2, in *frame*.
        alpha1: angular acceleration at *t1*, rad/s^2, in *frame*.
        revolutions: whole turns added about the axis of the middle factor; ``"least"`` finds the
            number of least effort.
        align: whether *q1* takes the sign nearer to *q0*.
    """

    name = "kks_quintic_hermite"
    summary = "two orientations with velocities and accelerations at both ends"
    source = "extension of Kim, Kim and Shin 1995, sec. 5.2"
    meets_end_accelerations = True

    shared: ClassVar[Mapping[str, Any]] = {
        **HermiteSegment.shared,
        **dict.fromkeys(("alpha0", "alpha1"), (0.0, 0.0, 0.0)),
    }

    def _solve(
        self,
        start: Floats,
        end: Floats,
        interval: tuple[float, float],
        omega0: Floats,
        omega1: Floats,
        revolutions: object,
        alpha0: Floats,
        alpha1: Floats,
    ) -> None:
        h = interval[1] - interval[0]
        first, fifth = h / 10.0 * omega0, h / 10.0 * omega1
        second = first + h * h / 40.0 * alpha0
        fourth = rotate(exp_half(fifth), fifth - h * h / 40.0 * alpha1)
        middle = between(start, end)
        for outer in (first, second):
            middle = multiply(exp_half(-outer), middle)
        for outer in (fifth, fourth):
            middle = multiply(middle, exp_half(-outer))
        vectors = np.stack([first, second, log_half(middle), fourth, fifth])
        self._set_factors(start, interval, revolutions, vectors)


class KksHermiteSpline(Product, Through):
    r"""Join keyframes by Hermite segments, each meeting the velocities at its ends.

    .. math:: q(t) = q_i \exp\bigl(w_1 \tilde\beta_1(u)\bigr)
              \exp\bigl(w_2 \tilde\beta_2(u)\bigr) \exp\bigl(w_3 \tilde\beta_3(u)\bigr),
              \quad u = (t - t_i) / h

    Each segment is the curve of Kim, Kim and Shin (1995), sec. 5.2, with :math:`w_1 = h v_i / 3`,
    :math:`w_3 = h v_{i+1} / 3`.  :math:`v_i` is half the angular velocity at keyframe *i*, which
    the paper leaves open.  *rule* names its estimate, see
    :func:`orientd.curves.hermite.half_velocities`.

    Picture: ``orientd plot kks_hermite_spline``.

    Args:
        rule: ``"parabola"``, ``"mean"`` or ``"chord"``.
        omega_start: body angular velocity at the first keyframe, rad/s, instead of the estimate.
        omega_end: body angular velocity at the last keyframe, rad/s, instead of the estimate.
    """

    name = "kks_hermite_spline"
    summary = "local C1 interpolation, end velocities met"
    source = "Kim, Kim and Shin 1995, sec. 5.2"
    local = True
    meets_end_velocities = True
    own: ClassVar[Mapping[str, Any]] = {"rule": "parabola", "omega_start": None, "omega_end": None}

    def _solve(
        self,
        q: Floats,
        instants: Floats,
        *,
        rule: str,
        omega_start: ArrayLike | None,
        omega_end: ArrayLike | None,
    ) -> None:
        rates = half_velocities(q, instants, rule)
        for place, name, omega in ((0, "omega_start", omega_start), (-1, "omega_end", omega_end)):
            if omega is not None:
                rates[place] = 0.5 * check_vector(omega, name)
        thirds = np.diff(instants)[:, None] / 3.0
        first, last = thirds * rates[:-1], thirds * rates[1:]
        after, before = exp_half(-first), exp_half(-last)
        middle = log_half(multiply(multiply(after, between(q[:-1], q[1:])), before))
        controls: Floats = np.empty((3 * len(first) + 1, 4))
        controls[::3] = q
        controls[1::3] = multiply(q[:-1], exp_half(first))
        controls[2::3] = multiply(q[1:], before)
        knots = np.concatenate([instants[:1], np.repeat(instants, 3), instants[-1:]])
        self._set_controls(
            cumulative_basis(knots, 4),
            controls,
            np.stack([first, middle, last], axis=1).reshape(-1, 3),
            1,
            ((2.0 * rates[0], None), (2.0 * rates[-1], None)),
        )


def half_velocities(keys: Floats, times: Floats, rule: str) -> Floats:
    r"""Return half the body angular velocity at each keyframe.

    Let :math:`L_i = \log(q_i^{-1} q_{i+1})` and :math:`h_i = t_{i+1} - t_i`.

    - ``"parabola"`` is the slope of the parabola through three keyframes,
      :math:`(h_{i-1} L_i / h_i + h_i L_{i-1} / h_{i-1}) / (h_{i-1} + h_i)`.
    - ``"mean"`` is the mean of the two rates.
    - ``"chord"`` is :math:`\log(q_{i-1}^{-1} q_{i+1}) / (h_{i-1} + h_i)`.

    At the ends all of them are the rate of the end segment.

    Returns:
        Half-angle rates in rad/s in the body frame at each keyframe, shape ``(n, 3)``.
    """
    check_choice(rule, "rule", RULES)
    steps = np.diff(times)[:, None]
    rates = increments(keys) / steps
    before, after = steps[:-1], steps[1:]
    if rule == "parabola":
        inner = (before * rates[1:] + after * rates[:-1]) / (before + after)
    elif rule == "mean":
        inner = 0.5 * (rates[1:] + rates[:-1])
    else:
        inner = log_half(between(keys[:-2], keys[2:])) / (before + after)
    return np.concatenate([rates[:1], inner, rates[-1:]])
