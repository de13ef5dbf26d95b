"""Kim and Nam's circular blending: the circles through three keyframes, blended pairwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Jet, check_defined, constant, rates, slerp
from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.keyframes import ParameterError, check_aligned, check_choice, resolve_times
from orientd.rotation import Floats

SAME = 1e-12
"""Quaternions closer than this do not tell one circle from another."""


class CircularBlending(Curve):
    r"""Blend, between two keyframes, the two circles on the sphere that pass through both.

    .. math:: C_i(\varphi) = c + u \cos\varphi + v \sin\varphi, \quad
              C_i(0) = q_{i-1},\; C_i(\varphi_1) = q_i,\; C_i(\varphi_2) = q_{i+1}

    .. math:: q(t) = \mathrm{slerp}\bigl(C_i(\varphi_i(t)),\; C_{i+1}(\varphi_{i+1}(t)),\;
              w(s)\bigr), \quad s = (t - t_i)/h_i

    Kim and Nam (1995); course notes, "Circular Arc Blending".  The notes exchange alpha and beta
    between text and steps, and their choice of *v* misses the third keyframe where it is nearer
    than the second.  No cases are needed: in the plane of the circle, with the first axis
    towards :math:`q_i` and :math:`q_{i+1}` above it, the way is counter-clockwise and the angles
    are twice those of the triangle of the keyframes (inscribed angles).

    With an angle linear in each interval and a linear weight, as in the notes, directions agree at
    the keyframes but speeds do not (they jump by half of their size): G1, not the C1 one reads.
    An angle *quadratic* over both intervals makes it C1; with the *smooth* weight
    :math:`3s^2 - 2s^3` as well it is C2.  In the end intervals there is one circle, not blended.

    Picture: ``orientd plot circular_blending``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least three, of which any three consecutive
            ones differ.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        param: angle along a circle: ``"linear"`` in each interval or ``"quadratic"`` over both.
        weight: blending weight: ``"linear"`` or ``"smooth"``.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said, or two of three consecutive keyframes are the
            same, so that no one circle passes through them.
    """

    name = "circular_blending"
    summary = "circles through three keyframes, blended between two"
    source = "Kim and Nam 1995; course notes, Circular Arc Blending"
    interpolates = True
    local = True
    takes = ("keys", "times", "param", "weight", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        param: str = "linear",
        weight: str = "linear",
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align, minimum=3)
        instants = resolve_times(times, q)
        is_quadratic = check_choice(param, "param", ("linear", "quadratic")) == "quadratic"
        self._is_smooth = check_choice(weight, "weight", ("linear", "smooth")) == "smooth"
        is_one_circle = len(q) == 3
        order = 0 if not is_quadratic else 2 if self._is_smooth or is_one_circle else 1
        super().__init__(knots=instants, continuity=order)
        self._circles, angles = circles(q)
        h = np.diff(instants)
        self._slopes = 1.0 / h
        first, second = angle_polynomials(angles, h, is_quadratic=is_quadratic)
        # Circle k passes through keys k to k + 2: the second half of k in interval k + 1, the
        # first half of k in interval k; the end intervals have one circle only.
        self._from = np.maximum(np.arange(len(h)) - 1, 0)
        self._to = np.minimum(np.arange(len(h)), len(h) - 2)
        self._from_angle = np.concatenate([first[:1], second])
        self._to_angle = np.concatenate([first, second[-1:]])

    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        elapsed = times - self._knots[span]
        slope = self._slopes[span]
        s = Jet(elapsed * slope, slope, np.zeros_like(slope))
        weight = (s * s).times(3.0) - (s * s * s).times(2.0) if self._is_smooth else s
        leaving = self._on_circle(self._from[span], self._from_angle[span], elapsed)
        arriving = self._on_circle(self._to[span], self._to_angle[span], elapsed)
        q, omega_body, alpha_body = rates(slerp(leaving, arriving, weight))
        check_defined(q, alpha_body, times)
        return q, omega_body, alpha_body

    def _on_circle(self, which: np.ndarray, polynomial: Floats, elapsed: Floats) -> Jet:
        a, b, c = polynomial.T
        angle = Jet(a + elapsed * (b + elapsed * c), b + 2.0 * elapsed * c, 2.0 * c)
        cosine, sine = np.cos(angle.value), np.sin(angle.value)
        center, u, v = self._circles[:, which]
        return (
            constant(center)
            + angle.composed(cosine, -sine, -cosine).widened().times(u)
            + angle.composed(sine, cosine, -sine).widened().times(v)
        )


def circles(q: Floats) -> tuple[Floats, Floats]:
    """Return the circles through each three consecutive keyframes, and their angles there.

    Returns:
        Centres, first and second radius vectors, shape ``(3, n - 2, 4)``; the angles of the
        second and the third keyframe, counted from the first, shape ``(2, n - 2)``.

    Raises:
        ValueError: two of three consecutive keyframes are the same.
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


def angle_polynomials(angles: Floats, h: Floats, *, is_quadratic: bool) -> tuple[Floats, Floats]:
    """Return the angle along each circle in its first and second interval.

    Args:
        angles: of the second and third keyframe of each circle, shape ``(2, n - 2)``.
        h: intervals, shape ``(n - 1,)``.
        is_quadratic: one parabola over both intervals, or a line in each.

    Returns:
        Coefficients of 1, *x* and *x* squared, *x* the time since the interval began, for the
        first and the second interval, each of shape ``(n - 2, 3)``.
    """
    before, after = h[:-1], h[1:]
    rise, climb = angles[0] / before, (angles[1] - angles[0]) / after
    bend = (climb - rise) / (before + after) if is_quadratic else np.zeros_like(rise)
    first = np.stack([np.zeros_like(rise), rise - bend * before, bend], axis=-1)
    slope = rise + bend * before if is_quadratic else climb
    second = np.stack([angles[0], slope, bend], axis=-1)
    return first, second
