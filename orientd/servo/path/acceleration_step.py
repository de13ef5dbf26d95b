r"""Where the acceleration of a path has a step between two records, and what that does to it.

Methods of continuity 1 have such steps at their knots, which lie anywhere between two cycles.  Let
the acceleration have a step *d* at the fraction *f* of the period *h*, and otherwise change evenly,
by *e* over the period.  With :math:`w = 1 - f`, what the two records say of orientation, velocity
and acceleration is

.. math::
    \alpha_b - \alpha_a &= d + e, \\
    (\omega_b - \omega_a) / h - \alpha_a &= d w + e / 2, \\
    2 (\theta - h \omega_a) / h^2 - \alpha_a &= d w^2 + e / 3,

from which *d* and *w* follow.  A cubic with the records' velocities is off there by
:math:`d h^2 E(u)`, where *E* is the bend :math:`\tfrac12 \max(u - f, 0)^2` less its own cubic
Hermite interpolant.  On a smooth path *d* is found to be of the second order of the period.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientd.driver import Vector3
from orientd.floats import difference
from orientd.servo.path.path_point import PathPoint

LEAST = 2e-7
"""What a step does to an angle within the period from which on it is looked for, rad."""


class AccelerationStep(NamedTuple):
    """A step of the acceleration.

    Attributes:
        place: where, in [0, 1].
        step: by how much, rad/s^2.
    """

    place: float
    step: Vector3

    def bend(self, u: float) -> tuple[float, float]:
        """Return *E* at *u* in [0, 1] and its slope."""
        w, v = 1.0 - self.place, 1.0 - u
        over = max(u - self.place, 0.0)
        value = 0.5 * over * over - u * u * w * (0.5 * w * (3.0 - 2.0 * u) - v)
        return value, over - u * w * (3.0 * v * w - 2.0 + 3.0 * u)


def find_kink(start: PathPoint, end: PathPoint, period: float) -> AccelerationStep | None:
    """Return the step between two records *period* seconds apart, or ``None`` if there is none."""
    a, b, p, q = start.alpha_body, end.alpha_body, start.omega_body, end.omega_body
    turn, least = difference(start.q, end.q), LEAST / (period * period)
    # The equations less the part of an even change: s = d (w - 1/2) and t = d (w^2 - 1/3).
    rise = x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    s = sx, sy, sz = (
        (q[0] - p[0]) / period - a[0] - 0.5 * x,
        (q[1] - p[1]) / period - a[1] - 0.5 * y,
        (q[2] - p[2]) / period - a[2] - 0.5 * z,
    )
    # The velocities do not commute: what they turn by together lacks a twelfth of their product.
    f, third = 2.0 / (period * period), 1.0 / 3.0
    t = tx, ty, tz = (
        f * (turn[0] - period * p[0]) - (p[1] * q[2] - p[2] * q[1]) / 6.0 - a[0] - third * x,
        f * (turn[1] - period * p[1]) - (p[2] * q[0] - p[0] * q[2]) / 6.0 - a[1] - third * y,
        f * (turn[2] - period * p[2]) - (p[0] * q[1] - p[1] * q[0]) / 6.0 - a[2] - third * z,
    )
    ss, tt = sx * sx + sy * sy + sz * sz, tx * tx + ty * ty + tz * tz
    if max(ss, tt) < least * least:
        return None
    # Two places explain the same records; the change between the steps tells which is meant.
    kinks = [_kink(w, s, t) for w in _places(ss, sx * tx + sy * ty + sz * tz, tt)]
    return min(kinks, key=lambda step: _squared_gap(rise, step.step), default=None)


def _places(ss: float, st: float, tt: float) -> list[float]:
    """Return each *w* in [0, 1] for which ``s (w^2 - 1/3) = t (w - 1/2)``."""
    over, under = (st, ss) if ss > tt else (tt, st)
    # (w^2 - 1/3) / (w - 1/2) = k = over / under, without dividing by what may be zero.
    root = sqrt((over - under) ** 2 + under * under / 3.0)
    halves = ((over + root), (over - root))
    if abs(under) <= 1e-12 * abs(over):
        return [0.5]
    return [w for w in (half / (2.0 * under) for half in halves) if 0.0 <= w <= 1.0]


def _kink(w: float, s: Vector3, t: Vector3) -> AccelerationStep:
    m, n = w - 0.5, w * w - 1.0 / 3.0
    m, n = m / (m * m + n * n), n / (m * m + n * n)
    return AccelerationStep(
        1.0 - w, (m * s[0] + n * t[0], m * s[1] + n * t[1], m * s[2] + n * t[2])
    )


def _squared_gap(a: Vector3, b: Vector3) -> float:
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
