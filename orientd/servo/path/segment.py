r"""One segment of the path: the cubic Hermite quaternion curve between two path records.

Kim, Kim and Shin (1995), section 5.2, with the velocities of the two records at its ends:

.. math::
    q(u) = q_a \exp(w_1 \beta_1(u)) \exp(w_2 \beta_2(u)) \exp(w_3 \beta_3(u)), \quad
    \beta_1 = 1-(1-u)^3,\ \beta_2 = 3u^2-2u^3,\ \beta_3 = u^3

with the half-angle increments :math:`w_1 = h\Omega_a/6`, :math:`w_3 = h\Omega_b/6` and
:math:`w_2 = \log(\exp(-w_1) q_a^{-1} q_b \exp(-w_3))`.  Here all rotation vectors are whole angles,
twice the paper's.  At ``u = 0`` the record itself is returned, untouched by rounding.

Between two records a smooth curve is met to the fourth order of the period.  Where the curve's
acceleration has a step inside (methods of continuity 1, at their knots) the accelerations of the
two records tell where, and the cubic is bent there (:mod:`orientd.servo.path.acceleration_step`).
"""

from __future__ import annotations

from orientd.driver import Vector3
from orientd.floats import conjugate, exp, log, multiply, normalize, rotate_back
from orientd.servo.path.acceleration_step import find_kink
from orientd.servo.path.path_point import PathPoint


class Segment:
    """The path between two neighbouring records.

    Args:
        start: the earlier record's point.
        end: the later record's point.
        period: path time between them, s.
    """

    __slots__ = ("_end", "_first", "_kink", "_last", "_middle", "_period", "start")

    def __init__(self, start: PathPoint, end: PathPoint, period: float) -> None:
        self.start = start
        self._end = end
        self._period = period
        third = period / 3.0
        x, y, z = start.omega_body
        self._first = (x * third, y * third, z * third)
        x, y, z = end.omega_body
        self._last = (x * third, y * third, z * third)
        turn = multiply(conjugate(start.q), end.q)
        turn = multiply(conjugate(exp(self._first)), multiply(turn, conjugate(exp(self._last))))
        self._middle = log(turn)
        self._kink = find_kink(start, end, period)

    def at(self, u: float) -> PathPoint:
        """Return the point at the fraction *u* of the segment, in [0, 1)."""
        if u == 0.0:
            return self.start
        v = 1.0 - u
        first, middle, last, h = self._first, self._middle, self._last, self._period
        b1, b2, b3 = 1.0 - v * v * v, u * u * (3.0 - 2.0 * u), u * u * u
        d1, d2, d3 = 3.0 * v * v / h, 6.0 * u * v / h, 3.0 * u * u / h
        e2 = exp((middle[0] * b2, middle[1] * b2, middle[2] * b2))
        e3 = exp((last[0] * b3, last[1] * b3, last[2] * b3))
        e23 = multiply(e2, e3)
        e1 = exp((first[0] * b1, first[1] * b1, first[2] * b1))
        q = normalize(multiply(self.start.q, multiply(e1, e23)))
        r1, r2 = rotate_back(e23, first), rotate_back(e3, middle)
        omega = (
            r1[0] * d1 + r2[0] * d2 + last[0] * d3,
            r1[1] * d1 + r2[1] * d2 + last[1] * d3,
            r1[2] * d1 + r2[2] * d2 + last[2] * d3,
        )
        if self._kink is not None:
            x, y, z = self._kink.step
            bend, slope = self._kink.bend(u)
            turn, rate = bend * h * h, slope * h
            q = normalize(multiply(q, exp((turn * x, turn * y, turn * z))))
            omega = (omega[0] + rate * x, omega[1] + rate * y, omega[2] + rate * z)
        a, b = self.start.alpha_body, self._end.alpha_body
        alpha = (a[0] * v + b[0] * u, a[1] * v + b[1] * u, a[2] * v + b[2] * u)
        return PathPoint(q, omega, alpha, *self._position(u, v))

    def _position(self, u: float, v: float) -> tuple[Vector3, Vector3]:
        """Return the cubic Hermite position and velocity at *u* = 1 - *v*."""
        h = self._period
        p, q = self.start.position, self._end.position
        if p == q and self.start.velocity == self._end.velocity == (0.0, 0.0, 0.0):
            return p, self.start.velocity
        hp, hv, hq, hw = (
            v * v * (1.0 + 2.0 * u),
            u * v * v * h,
            u * u * (3.0 - 2.0 * u),
            -u * u * v * h,
        )
        dp, dv, dw = -6.0 * u * v / h, v * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
        position, velocity = [], []
        for a, b, s, e in zip(p, q, self.start.velocity, self._end.velocity, strict=True):
            position.append(a * hp + s * hv + b * hq + e * hw)
            velocity.append((a - b) * dp + s * dv + e * dw)
        return (position[0], position[1], position[2]), (velocity[0], velocity[1], velocity[2])
