"""Families on the sphere of unit quaternions: a solved B-spline, normalised cubics, circles.

Nielson and Heiland's B-spline is a triangle of slerps with control quaternions from a solver.  The
nu-spline and its special case, the normalised cubic, are normalised splines of the four components.
Kim and Nam's curve blends circles through three keyframes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.contract import Through
from orientd.curves.keyframes import ParameterError, check_choice, check_numbers
from orientd.curves.newton import Linearised, newton, solve_banded, solve_blocks
from orientd.curves.triangles import CubicSegments, moving_slerp
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    log_half,
    multiply,
    normalize,
    right_jacobian,
    right_jacobian_inverse,
    rotate,
    slerp,
)

SAME = 1e-12
"""Quaternions closer than this do not define a circle."""


class NielsonHeiland(CubicSegments):
    r"""Interpolate keyframes by the spherical analogue of the interpolating cubic B-spline.

    .. math:: L_i = G[D_{i-1}, D_i](l_i), \quad R_i = G[D_i, D_{i+1}](r_i), \quad
              G[L_i, R_i](f_i) = q_i, \qquad D_0 = q_0,\; D_n = q_n

    and cubic slerp segments over :math:`q_i, R_i, L_{i+1}, q_{i+1}`.  With equal intervals the
    fractions are 2/3, 1/3 and 1/2; otherwise

    .. math:: l_i = \frac{h_{i-2} + h_{i-1}}{h_{i-2} + h_{i-1} + h_i}, \quad
              r_i = \frac{h_{i-1}}{h_{i-1} + h_i + h_{i+1}}, \quad
              f_i = \frac{h_{i-1}}{h_{i-1} + h_i}

    where the intervals beyond the ends equal their neighbours.

    Nielson and Heiland (1992); Nielson (1993), eq. 22, which solves for the control quaternions
    *D* by the iteration

    .. math:: D_i \leftarrow \frac{\beta_i q_i - \alpha_i(\tfrac13) D_{i-1}
              - \alpha_{i+1}(\tfrac13) D_{i+1}}{\alpha_i(\tfrac23) + \alpha_{i+1}(\tfrac23)},
              \quad \alpha_i(t) = \frac{\sin t\theta_i}{\sin\theta_i}

    The paper prints :math:`\sin(\theta_i/2)` in the denominator and the indices of alpha one too
    low. With these it converges to a curve that misses the keyframes by up to 100 degrees.  The
    corrected iteration must normalise each *D* for steps of 135 degrees and more, and some of its
    fixed points do not interpolate.  Here Newton's method solves :math:`\log(q_i^{-1} G[L_i,
    R_i](f_i)) = 0` instead, with exact derivatives, and the residual is the test.  Large steps may
    have no solution.  Of 50 sets of ten random keyframes, all had one at steps of 135 degrees, four
    fifths at 160, and two thirds at 170.

    The velocity is continuous, the acceleration almost (it jumps by 1.4 % at steps of 60 degrees).
    At the ends the acceleration is zero.

    Picture: ``orientd plot nielson_heiland``.

    Raises:
        PlanError: the search found no control quaternions whose curve passes through the keyframes.
    """

    name = "nielson_heiland"
    summary = "spherical B-spline solved to interpolate"
    source = "Nielson and Heiland 1992; Nielson 1993, eq. 22"

    def _solve(self, q: Floats, instants: Floats) -> None:
        h = np.diff(instants)
        padded = np.concatenate([h[:1], h, h[-1:]])
        total = padded[:-2] + padded[1:-1] + padded[2:]
        # Fractions of R_i and L_{i+1} on the arc from D_i to D_{i+1}, and of q_i between L_i and
        # R_i.
        right, left = padded[:-2] / total, (padded[:-2] + padded[1:-1]) / total
        d = control_quaternions(q, right, left, h[:-1] / (h[:-1] + h[1:]))
        after, before = slerp(d[:-1], d[1:], right), slerp(d[:-1], d[1:], left)
        self._set_cubics(q, after, before, instants, 1 if len(q) > 2 else 2)


def control_quaternions(q: Floats, r: Floats, left: Floats, f: Floats) -> Floats:
    """Return the control quaternions *D*, by Newton's method on their right increments.

    The fractions are those of the formula: of the inner points after each keyframe and before the
    next, and of the inner keyframes.

    Raises:
        PlanError: it does not converge.
    """
    least = np.inf
    rows = 3 * np.arange(len(q) - 2)

    def equations(d: Floats) -> Linearised:
        nonlocal least
        before, after = slerp(d[:-2], d[1:-1], left[:-1]), slerp(d[1:-1], d[2:], r[1:])
        missed = log_half(multiply(conjugate(q[1:-1]), slerp(before, after, f)))
        least = min(least, float(np.max(np.abs(missed), initial=0.0)))

        def step() -> Floats:
            first, second = slerp_jacobians(d[:-2], d[1:-1], left[:-1])
            third, fourth = slerp_jacobians(d[1:-1], d[2:], r[1:])
            back = right_jacobian_inverse(2.0 * missed)
            by_before, by_after = (back @ part for part in slerp_jacobians(before, after, f))
            blocks = np.concatenate(
                [by_before @ first, by_before @ second + by_after @ third, by_after @ fourth],
                axis=2,
            )
            return solve_blocks(blocks, rows, rows - 3, -missed.ravel()).reshape(-1, 3)

        return missed, step

    def moved(d: Floats, step: Floats) -> Floats:
        there = d.copy()
        there[1:-1] = normalize(multiply(d[1:-1], exp_half(step)))
        return there

    found = q.copy() if len(q) == 2 else newton(equations, q.copy(), move=moved, longest=0.5)
    if found is None:
        raise PlanError(
            "no spherical B-spline of Nielson and Heiland was found through the keyframes: at best "
            f"it misses one by {2.0 * least:.3g} rad; put keyframes in between, or "
            "make neighbouring intervals more alike"
        )
    return found


def slerp_jacobians(p: Floats, q: Floats, u: Floats) -> tuple[Floats, Floats]:
    r"""Return the derivatives of a slerp by right increments of both ends.

    With :math:`w = \log(p^{-1} q)` as a rotation vector, increments *a* of *p* and *b* of *q* turn
    the slerp by :math:`\exp(-u w)\, a + u J_r(u w) (J_r^{-1}(w)\, b - J_l^{-1}(w)\, a)`.
    """
    w = 2.0 * log_half(multiply(conjugate(p), q))
    turn = exp_half(0.5 * u[:, None] * w)
    along = u[:, None, None] * right_jacobian(u[:, None] * w)
    back = np.swapaxes(rotate(conjugate(turn)[:, None], np.eye(3)), 1, 2)
    return back - along @ right_jacobian_inverse(-w), along @ right_jacobian_inverse(w)


class ComponentSpline(Through):
    """A normalised cubic spline of the four components with tension at the keyframes."""

    def _set_spline(self, q: Floats, instants: Floats, tension: Floats) -> None:
        """Set up the spline; *tension* is not negative, in 1/s, shape ``(n,)``.

        Raises:
            PlanError: it passes through zero.
        """
        self._set_knots(instants, 1 if np.any(tension[1:-1] > 0.0) else 2)
        h = np.diff(instants)[:, None]
        slopes = spline_slopes(q, instants, tension)
        step = np.diff(q, axis=0)
        leave, arrive = h * slopes[:-1] - step, h * slopes[1:] - step
        # Coefficients of each segment's cubic in the share of its interval.
        self._cubics = np.stack(
            [q[:-1], step + leave, -2.0 * leave - arrive, leave + arrive], axis=1
        )
        self._check_direction()

    def _orientations(self, times: Floats) -> Floats:
        return normalize(self._components(*self._shares(times)))

    def _components(self, span: np.ndarray, u: Floats) -> Floats:
        """Return the spline itself, before normalisation."""
        a, b, c, d = np.moveaxis(self._cubics[span], -2, 0)
        share = u[..., None]
        found: Floats = a + share * (b + share * (c + share * d))
        return found

    def _check_direction(self) -> None:
        """Refuse a spline that passes through zero."""
        spans, places = np.arange(len(self._cubics))[:, None], np.linspace(0.0, 1.0, 33)[None]
        length = np.linalg.norm(self._components(spans, places), axis=-1)
        # Examine only segments whose length can reach zero between two samples.
        lost = np.linalg.norm(self._cubics, axis=-1) @ np.array([0.0, 1.0, 2.0, 3.0]) / 64.0
        for span in np.flatnonzero(length.min(axis=1) <= lost):
            parts = (np.polynomial.Polynomial(row) for row in self._cubics[span].T)
            slope = sum((part * part.deriv() for part in parts), np.polynomial.Polynomial([0.0]))
            u = np.clip(slope.roots().real, 0.0, 1.0)
            found = np.linalg.norm(self._components(np.full(len(u), span), u), axis=-1)
            if found.min(initial=np.inf) <= 1e-12:
                share = u[int(np.argmin(found))]
                instant = float(self._knots[span] + share * np.diff(self._knots)[span])
                raise PlanError(
                    f"the spline passes through zero at t = {instant!r} s and has no direction "
                    "there; put a keyframe in between"
                )


class NuSpline(ComponentSpline):
    r"""Interpolate quaternions by a cubic spline with tension, then normalise it.

    .. math:: \min \int \|c''\|^2 dt + \sum_i \nu_i \|c'(t_i)\|^2, \qquad q = c / \|c\|

    Nielson (1986; 1993, sec. 2.2).  Tension slows the curve at its keyframe and straightens tight
    bends. The acceleration jumps there by :math:`\nu_i` times the velocity, along it.  So the path
    has continuous curvature (G2) while the motion is C1.  Without tension it is C2.

    Picture: ``orientd plot nu_spline``.

    Args:
        nu: tension, not negative, in 1/s: one number, or one for each keyframe, including the ends.

    Raises:
        PlanError: the spline passes through zero, where it has no direction.
    """

    name = "nu_spline"
    summary = "normalised cubic spline with tension at the keyframes"
    source = "Nielson 1986; Nielson 1993, sec. 2.2"
    own: ClassVar[Mapping[str, Any]] = {"nu": 0.0}

    def _solve(self, q: Floats, instants: Floats, *, nu: float | ArrayLike) -> None:
        self._set_spline(q, instants, check_tension(nu, len(q)))


class NormalizedCubic(ComponentSpline):
    r"""Interpolate quaternions by the natural cubic spline in four dimensions, then normalise it.

    .. math:: q(t) = c(t) / \|c(t)\|

    Nielson (1993), sec. 2.2.  It is C2 unless *c* passes through zero.  If it passes near zero,
    cusps and tight bends appear, which takes steps of nearly half the sphere.  The course notes
    call the spline of least :math:`\int \|c''\|^2` the complete one; without given end slopes it is
    the natural one.

    Picture: ``orientd plot normalized_cubic``.

    Raises:
        PlanError: the spline passes through zero, where it has no direction.
    """

    name = "normalized_cubic"
    summary = "natural cubic spline of the components, normalised"
    source = "Nielson 1993, sec. 2.2"

    def _solve(self, q: Floats, instants: Floats) -> None:
        self._set_spline(q, instants, np.zeros(len(q)))


def check_tension(nu: object, count: int) -> Floats:
    """Return a tension for each of *count* keyframes."""
    expected = f"a number or one for each of the {count} keyframes, not negative"
    array = check_numbers(nu, "nu", expected)
    if array.shape not in ((), (count,)) or not np.all(np.isfinite(array) & (array >= 0.0)):
        raise ParameterError("nu", f"nu must be {expected}, got {nu!r}")
    tension: Floats = np.full(count, array, dtype=np.float64)
    return tension


def spline_slopes(points: Floats, times: Floats, tension: Floats) -> Floats:
    r"""Return the slopes :math:`m_i` of the spline at its points.

    It is a cubic in each interval, and the slopes are continuous, as they satisfy

    .. math:: \frac{2 m_{i-1} + 4 m_i}{h_{i-1}} + \frac{4 m_i + 2 m_{i+1}}{h_i} + \nu_i m_i =
              \frac{6 \Delta_{i-1}}{h_{i-1}^2} + \frac{6 \Delta_i}{h_i^2}

    (Nielson, 1986).  Without tension it is the natural cubic spline.  *tension* is not negative;
    time and memory grow linearly.
    """
    h = np.diff(times)
    pull = 6.0 * np.diff(points, axis=0) / (h * h)[:, None]
    bands = np.zeros((3, len(points)))
    bands[0, 1:] = bands[2, :-1] = 2.0 / h
    bands[1] = tension
    bands[1, :-1] += 4.0 / h
    bands[1, 1:] += 4.0 / h
    right = np.zeros_like(points)
    right[:-1] += pull
    right[1:] += pull
    return solve_banded(1, 1, bands, right)


class CircularBlending(Through):
    r"""Blend, between two keyframes, the two circles on the sphere that pass through both.

    .. math:: C_i(\varphi) = c + u \cos\varphi + v \sin\varphi, \quad
              C_i(0) = q_{i-1},\; C_i(\varphi_1) = q_i,\; C_i(\varphi_2) = q_{i+1}

    .. math:: q(t) = \mathrm{slerp}\bigl(C_i(\varphi_i(t)),\; C_{i+1}(\varphi_{i+1}(t)),\;
              w(s)\bigr), \quad s = (t - t_i)/h_i

    Kim and Nam (1995); course notes, "Circular Arc Blending".  The notes exchange alpha and beta
    between text and steps.  Their choice of *v* misses the third keyframe if it is nearer than the
    second. No special cases are needed.  Take the plane of the circle with the first axis towards
    :math:`q_i` and :math:`q_{i+1}` above it.  The arc then runs counter-clockwise, and the angles
    are twice those of the triangle of the keyframes (inscribed angles).

    With an angle linear in each interval and a linear weight, as in the notes, directions agree at
    the keyframes but speeds do not (they jump by half of their size): G1, not C1 as stated.
    An angle *quadratic* over both intervals makes it C1.  With the *smooth* weight
    :math:`3s^2 - 2s^3` as well it is C2.  The end intervals have one circle, without blending.

    Picture: ``orientd plot circular_blending``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least three; any three consecutive ones differ.
        param: angle along a circle: ``"linear"`` in each interval or ``"quadratic"`` over both.
        weight: blending weight: ``"linear"`` or ``"smooth"``.
    """

    name = "circular_blending"
    summary = "circles through three keyframes, blended between two"
    source = "Kim and Nam 1995; course notes, Circular Arc Blending"
    local = True

    fewest = 3
    own: ClassVar[Mapping[str, Any]] = {"param": "linear", "weight": "linear"}

    def _solve(self, q: Floats, instants: Floats, *, param: str, weight: str) -> None:
        is_quadratic = check_choice(param, "param", ("linear", "quadratic")) == "quadratic"
        self._is_smooth = check_choice(weight, "weight", ("linear", "smooth")) == "smooth"
        is_one_circle = len(q) == 3
        order = 0 if not is_quadratic else 2 if self._is_smooth or is_one_circle else 1
        self._set_knots(instants, order)
        self._circles, self._angles = circles(q)
        self._is_quadratic = is_quadratic

    def _orientations(self, times: Floats) -> Floats:
        span, s = self._shares(times)
        weight = s * s * (3.0 - 2.0 * s) if self._is_smooth else s
        # Circle k passes through keys k to k + 2; the end intervals have one circle only.
        leaving = self._on_circle(np.maximum(span - 1, 0), times)
        arriving = self._on_circle(np.minimum(span, len(self._knots) - 3), times)
        return moving_slerp(leaving, arriving, weight, times)

    def _on_circle(self, which: np.ndarray, times: Floats) -> Floats:
        """Return the points of some circles at *times* in one of their two intervals."""
        begin, middle, end = (self._knots[which + one] for one in range(3))
        second, third = self._angles[:, which]
        rise, climb = second / (middle - begin), (third - second) / (end - middle)
        before, after = times - begin, times - middle
        if self._is_quadratic:
            angle = before * (rise + after * (climb - rise) / (end - begin))
        else:
            angle = np.where(after < 0.0, rise * before, second + climb * after)
        center, u, v = self._circles[:, which]
        along, across = np.cos(angle)[:, None], np.sin(angle)[:, None]
        return normalize(center + along * u + across * v)


def circles(q: Floats) -> tuple[Floats, Floats]:
    """Return the circles through each three consecutive keyframes, and the keyframes' angles.

    Returns:
        Centres, first and second radius vectors, shape ``(3, n - 2, 4)``; the angles of the
        second and the third keyframe, counted from the first, shape ``(2, n - 2)``.
    """
    to_second, to_third = q[1:-1] - q[:-2], q[2:] - q[:-2]
    e, f, g = np.linalg.norm([to_second, q[2:] - q[1:-1], to_third], axis=-1)
    for gap, step in ((e, 1), (f, 1), (g, 2)):
        if not np.all(gap > SAME):
            place = int(np.argmin(gap)) + (1 if gap is not e and step == 1 else 0)
            raise ParameterError(
                "keys",
                "keys must have any three consecutive ones different for a circle through them, "
                f"got keys[{place}] and keys[{place + step}] the same",
            )
    first_axis = to_second / e[:, None]
    x = np.sum(to_third * first_axis, axis=-1)
    rest = to_third - x[:, None] * first_axis
    y = np.linalg.norm(rest, axis=-1)
    second_axis = rest / y[:, None]
    height = (x * (x - e) + y * y) / (2.0 * y)
    center = q[:-2] + 0.5 * to_second + height[:, None] * second_axis
    u = -0.5 * to_second - height[:, None] * second_axis
    v = height[:, None] * first_axis - 0.5 * e[:, None] * second_axis
    second = 2.0 * np.arctan2(y * e, y * y + x * (x - e))
    third = second + 2.0 * np.arctan2(y, x)
    return np.stack([center, u, v]), np.stack([second, third])
