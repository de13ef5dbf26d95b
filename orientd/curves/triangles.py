r"""Families that are weights of one triangle of slerps: Bezier, B-spline, Catmull-Rom, squad.

A point of the curve is the top of a triangle whose base is the control quaternions of the segment.
Every entry is the slerp of the two below it (Barry and Goldman, 1988; Schlag, 1991):

.. math:: P_j^r(t) = \mathrm{slerp}\Bigl(P_j^{r-1}(t),\; P_{j+1}^{r-1}(t),\;
          \frac{t - a_{r,j}}{b_{r,j} - a_{r,j}}\Bigr), \qquad P_j^0 = P_j

Only the intervals ``[a, b]`` differ.  For a Bezier curve all are the segment.  For a B-spline they
are runs of knots that shorten upwards.  For a Catmull-Rom spline the runs lengthen, then shorten.
Outside ``[a, b]`` the slerp extrapolates, as Catmull-Rom needs, and must not clamp.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from orientd.curves.contract import Curve, Drawn, DrawnOverKnots, Through
from orientd.curves.hermite import half_velocities
from orientd.curves.keyframes import (
    ParameterError,
    check_choice,
    check_interval,
    check_number,
    increments,
    inner_multiplicity,
)
from orientd.curves.products import with_phantoms
from orientd.errors import PlanError
from orientd.rotation import Floats, between, conjugate, exp_half, log_half, multiply, power, slerp

ANTIPODAL = 1e-14
"""Quaternions closer than this to opposite ones do not define the arc between them."""

Intervals = Sequence[tuple[Floats, Floats]]
"""Starts and ends of the intervals of the entries, shape ``(segments, entries)``, for each level.

The levels count from the base of the triangle up.
"""


class TriangleCurve(Curve):
    """A curve whose segments are slerp triangles, each over its own control quaternions."""

    def _set_triangles(
        self, knots: Floats, points: Floats, continuity: int, intervals: Intervals | None = None
    ) -> None:
        """Set up the curve of control quaternions, shape ``(segments, order, 4)``.

        By default the *intervals* are those of a Bezier curve.
        """
        self._set_knots(knots, continuity)
        self._points = points
        segment = self._knots[:-1, None], self._knots[1:, None]
        self._intervals = [segment] * (points.shape[1] - 1) if intervals is None else intervals

    def _orientations(self, times: Floats) -> Floats:
        segments = self._shares(times)[0]
        entries = self._points[segments]
        for starts, ends in self._intervals:
            first, last = starts[segments], ends[segments]
            shares = (times[:, None] - first) / (last - first)
            entries = moving_slerp(entries[:, :-1], entries[:, 1:], shares, times)
        return entries[:, 0]


def moving_slerp(p: Floats, q: Floats, shares: Floats, times: Floats) -> Floats:
    """Return the slerps between moving points, whose first axis is that of the times.

    Raises:
        PlanError: two of them are antipodal, so that the arc between them is undefined.
    """
    step = between(p, q)
    is_open = (step[..., 0] < 0.0) & (np.max(np.abs(step[..., 1:]), axis=-1) < ANTIPODAL)
    if is_open.any():
        instant = float(times[np.nonzero(is_open)[0][0]])
        raise PlanError(
            f"the construction is not defined at t = {instant!r} s: "
            "a slerp joins antipodal quaternions there; put a keyframe in between"
        )
    return multiply(p, power(step, shares))


class CubicSegments(TriangleCurve, Through):
    """Cubic slerp segments through keyframes, each over two control quaternions between them."""

    def _set_cubics(
        self,
        q: Floats,
        after: Floats,
        before: Floats,
        instants: Floats,
        continuity: int | None = None,
    ) -> None:
        """Set up the curve of keyframes, with control quaternions after and before each.

        By default the *continuity* is that of inner points equally far from a keyframe.
        """
        if continuity is None:
            h = np.diff(instants)
            continuity = 2 if len(q) == 2 else int(np.ptp(h) <= 1e-12 * h.max())
        points = np.stack([q[:-1], after, before, q[1:]], axis=1)
        self._set_triangles(instants, points, continuity)


class DeCasteljau(TriangleCurve, Drawn):
    r"""Draw one spherical Bezier curve from the first control quaternion to the last.

    .. math:: s_i^k(t) = G[s_{i-1}^{k-1}, s_i^{k-1}](u), \quad u = (t - t_0)/(t_1 - t_0),
              \quad q(t) = s_n^n(t)

    Shoemake (1985); Nielson (1993), eq. 17, whose control points are numbered from 0.  The end
    rates are ``n log(s_0^-1 s_1)`` and ``n log(s_{n-1}^-1 s_n)``; Nielson prints the one at the
    end with the opposite sign.

    Picture: ``orientd plot de_casteljau``.
    """

    name = "de_casteljau"
    summary = "one Bezier segment of any degree by repeated slerp"
    source = "Shoemake 1985; Nielson 1993, eq. 17; Schlag 1991"

    shared: ClassVar[Mapping[str, Any]] = {**Drawn.shared, "align": False}
    own: ClassVar[Mapping[str, Any]] = {"t0": 0.0, "t1": 1.0}

    def _solve(self, controls: Floats, *, t0: float, t1: float) -> None:
        self._set_triangles(np.array(check_interval(t0, t1)), controls[None], 2)


class ShoemakeBezier(CubicSegments):
    r"""Join keyframes by cubic slerp segments whose inner points average the neighbours.

    .. math:: D_i = 2 (q_{i-1} \cdot q_i)\, q_i - q_{i-1}, \quad
              R_i = \frac{D_i + q_{i+1}}{\|D_i + q_{i+1}\|}, \quad
              \mathrm{out}_i = \mathrm{slerp}(q_i, R_i, s), \quad
              \mathrm{in}_i = \mathrm{slerp}(q_i, R_i, -s)

    Shoemake (1985).  The course notes print the reflection as ``2 (p.q) - q``; its first term needs
    the factor *q*.  They list the inner points as ``q_0, a_0, b_0, q_1``, but the construction puts
    ``b_n`` before ``q_n``.  They leave the outermost inner points open; here these lie on the arcs
    to the neighbours.  With *s* = 1, as printed there and by Nielson (1993), the speed at a
    keyframe is three times that of the neighbours; *s* = 1/3 is Shoemake's truncation and the
    default.

    First derivatives agree at the keyframes for equal intervals only; otherwise directions do.

    Picture: ``orientd plot shoemake_bezier``.

    Args:
        s: shortening of the arcs to the inner points, in ``(0, 1]``, a number or a fraction such
            as ``"1/3"``.

    Raises:
        PlanError: the neighbours of a keyframe have no bisector.
    """

    name = "shoemake_bezier"
    summary = "cubic slerp segments, tangents from bisected reflections"
    source = "Shoemake 1985; Nielson 1993, sec. 2.2"
    local = True
    own: ClassVar[Mapping[str, Any]] = {"s": "1/3"}

    def _solve(self, q: Floats, instants: Floats, *, s: float | str) -> None:
        share = check_share(s, "s")
        ahead = np.concatenate([q[1:2], bisected_reflections(q), q[-2:-1]])
        after = slerp(q[:-1], ahead[:-1], share)
        before = slerp(q[1:], ahead[1:], np.append(np.full(len(q) - 2, -share), share))
        self._set_cubics(q, after, before, instants)


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
    """Return a number in ``(0, 1]``, given as a number or as text of a fraction."""
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


class BezierCatmullRom(CubicSegments):
    r"""Join keyframes by cubic slerp segments with inner points a sixth of the step across.

    .. math:: R_i = G[q_i,\; q_{i+1} q_{i-1}^{-1} q_i](1/6), \quad
              L_i = G[q_i,\; q_{i-1} q_{i+1}^{-1} q_i](1/6)

    Nielson (1993), sec. 2.2, whose second line defines :math:`L_{i+1}` but prints :math:`L_i`.  The
    ends have phantom neighbours :math:`q_0 q_1^{-1} q_0`.  Nielson calls it Schlag's Catmull-Rom
    curve.  This holds for rotations about one axis only.  Otherwise the two differ (2.5 degrees at
    steps of 45, 31 at steps of 135).

    First derivatives agree at the keyframes for equal intervals only; otherwise directions do.

    Picture: ``orientd plot bezier_catmull_rom``.

    Args:
        order: ``"hamilton"`` as above, ``"reversed"`` with the products in the other order
            (:math:`q_i q_{i-1}^{-1} q_{i+1}`), which is another curve.
    """

    name = "bezier_catmull_rom"
    summary = "cubic slerp segments, tangents from central differences"
    source = "Nielson 1993, sec. 2.2"
    local = True
    own: ClassVar[Mapping[str, Any]] = {"order": "hamilton"}

    def _solve(self, q: Floats, instants: Floats, *, order: str) -> None:
        is_reversed = check_choice(order, "order", ("hamilton", "reversed")) == "reversed"
        padded = with_phantoms(q)
        before, after = conjugate(padded[:-2]), padded[2:]
        ahead = (
            multiply(q, multiply(before, after))
            if is_reversed
            else multiply(after, multiply(before, q))
        )
        # L_i is R_i reflected.  Computed in this way, both lie on one arc even if keyframes half a
        # turn apart do not define its direction.
        right, left = slerp(q, ahead, 1.0 / 6.0), slerp(q, ahead, -1.0 / 6.0)
        self._set_cubics(q, right[:-1], left[1:], instants)


class SchlagCatmullRom(TriangleCurve, Through):
    r"""Interpolate keyframes by a triangle of slerps over four of them at a time.

    .. math:: \frac{t - t_i}{t_{i+1} - t_i}; \quad
              \frac{t - t_{i-1}}{t_{i+1} - t_{i-1}}, \frac{t - t_i}{t_{i+2} - t_i}; \quad
              \frac{t - t_{i-1}}{t_i - t_{i-1}}, \frac{t - t_i}{t_{i+1} - t_i},
              \frac{t - t_{i+1}}{t_{i+2} - t_{i+1}}

    from the top of the triangle to its base.  Schlag (1991), after Barry and Goldman (1988).  In
    the printed uniform triangle *t* counts from the segment's own start, and the outer slerps of
    the base extrapolate (u = t + 1 and t - 1), so they must not clamp; ``sin(1-u)theta`` there
    reads :math:`\sin((1-u)\theta)`.  The velocity is continuous at the keyframes for any times,
    the acceleration is not.

    Picture: ``orientd plot schlag_catmull_rom``.

    Args:
        ends: ``"phantom"``: the keyframes next to the ends reflected in them, :math:`q_0 q_1^{-1}
            q_0`, and the end intervals mirrored.
    """

    name = "schlag_catmull_rom"
    summary = "Catmull-Rom by a triangle of slerps"
    source = "Schlag 1991, after Barry and Goldman 1988"
    local = True
    own: ClassVar[Mapping[str, Any]] = {"ends": "phantom"}

    def _solve(self, q: Floats, instants: Floats, *, ends: str) -> None:
        check_choice(ends, "ends", ("phantom",))
        window = np.arange(len(q) - 1)[:, None] + np.arange(4)[None, :]
        before, after = 2.0 * instants[[0, -1]] - instants[[1, -2]]
        t = np.concatenate([[before], instants, [after]])[window]
        intervals = [(t[:, 0:3], t[:, 1:4]), (t[:, 0:2], t[:, 2:4]), (t[:, 1:2], t[:, 2:3])]
        self._set_triangles(instants, with_phantoms(q)[window], 1 if len(q) > 2 else 2, intervals)


class SchlagBSpline(TriangleCurve, DrawnOverKnots):
    r"""Approximate control quaternions by de Boor's triangle of slerps.

    .. math:: P_i^r(t) = \mathrm{slerp}\Bigl(P_{i-1}^{r-1}, P_i^{r-1},
              \frac{t - x_i}{x_{i+k-r} - x_i}\Bigr), \qquad q(t) = P_L^{k-1}(t)
              \text{ on } [x_L, x_{L+1})

    Schlag (1991).  The printed non-uniform cubic triangle has five of its six fractions: the
    first one of the base, :math:`(t - t_{q-2})/(t_{q+1} - t_{q-2})`, is missing, and the last
    control point is :math:`P_0`; in the uniform triangle *t* counts from the segment's start.
    Unlike in the plane the cubic is not C2: the acceleration jumps by 0.2 % of its size at steps of
    45 degrees and by 2 % at 170.  Kim, Kim and Shin (1995) mention this without figures.

    Picture: ``orientd plot schlag_bspline``.
    """

    name = "schlag_bspline"
    summary = "B-spline of any order by de Boor's triangle of slerps"
    source = "Schlag 1991, after de Boor 1972"
    local = True

    def _solve(self, points: Floats, size: int, x: Floats) -> None:
        spans = np.arange(size - 1, len(points))
        spans = spans[x[spans + 1] > x[spans]]
        # On the span of knot L, entry i of level r blends over [x_i, x_{i+k-r}],
        # i = L-k+1+r, ..., L.
        firsts = [spans[:, None] + np.arange(level - size + 1, 1) for level in range(size)]
        self._set_triangles(
            np.append(x[spans], x[len(points)]),
            points[firsts[0]],
            2 if len(spans) == 1 else min(1, size - 1 - inner_multiplicity(x, size)),
            [(x[i], x[i + size - r]) for r, i in enumerate(firsts[1:], 1)],
        )


class Squad(Through):
    r"""Blend the arc between two keyframes with the arc between two inner points.

    .. math:: q(t) = \mathrm{slerp}\bigl(\mathrm{slerp}(q_i, q_{i+1}, u),\;
              \mathrm{slerp}(a_i^+, a_{i+1}^-, u),\; 2u(1-u)\bigr)

    .. math:: a_i^+ = q_i \exp\bigl((h_i v_i - L_i)/2\bigr), \quad
              a_i^- = q_i \exp\bigl((L_{i-1} - h_{i-1} v_i)/2\bigr), \quad
              L_i = \log(q_i^{-1} q_{i+1})

    Shoemake (1987).  The course notes give the blend and leave the inner points open.  These inner
    points make the half-angle velocity at keyframe *i* equal :math:`v_i` from both sides for any
    times.  For equal times and the rule ``"parabola"`` they are the usual :math:`q_i \exp(-(\log
    q_i^{-1} q_{i+1} + \log q_i^{-1} q_{i-1})/4)`.  The acceleration jumps at the keyframes.  With
    very unequal intervals (ten to one at steps of 80 degrees) an exponent may pass pi; the velocity
    then jumps there too, and :attr:`continuity` is 0.

    Picture: ``orientd plot squad``.

    Args:
        rule: for the velocities at inner keyframes: the slope of the ``"parabola"`` through three
            keyframes, the ``"mean"`` of the two rates (as in numpy-quaternion), or the ``"chord"``
            across the keyframe.  At the ends it is the rate of the end interval.
    """

    name = "squad"
    summary = "spherical quadrangle blend of two great arcs"
    source = "Shoemake 1987; inner points for unequal times by the velocities at the keyframes"
    local = True
    own: ClassVar[Mapping[str, Any]] = {"rule": "parabola"}

    def _solve(self, q: Floats, instants: Floats, *, rule: str) -> None:
        h = np.diff(instants)[:, None]
        steps = increments(q)
        v = half_velocities(q, instants, rule)
        ahead, behind = 0.5 * (h * v[:-1] - steps), 0.5 * (steps - h * v[1:])
        is_smooth = max(np.sum(ahead**2, axis=1).max(), np.sum(behind**2, axis=1).max()) < np.pi**2
        self._set_knots(instants, 0 if not is_smooth else 1 if len(q) > 2 else 2)
        inner = multiply(q[:-1], exp_half(ahead))
        inner_end = multiply(q[1:], exp_half(behind))
        # The starts of the two arcs of each segment, and their steps.
        self._starts = np.stack([q[:-1], inner], axis=1)
        self._steps = np.stack([steps, log_half(multiply(conjugate(inner), inner_end))], axis=1)

    def _orientations(self, times: Floats) -> Floats:
        span, u = self._shares(times)
        arcs = multiply(self._starts[span], exp_half(u[:, None, None] * self._steps[span]))
        return moving_slerp(arcs[:, 0], arcs[:, 1], 2.0 * u * (1.0 - u), times)
