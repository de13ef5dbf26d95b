r"""The motion between two knots of which both have orientation, velocity and acceleration.

The rotation vector *r* from the first knot is a polynomial of degree five in the share *u* of the
time between the two, and :math:`q = q_a \exp(r(u))`.  With the right Jacobian of the exponential,

.. math::
    \omega = J_r(r)\, \dot r, \qquad \alpha = J_r(r)\, \ddot r + \dot J_r(r)\, \dot r,

so that :math:`\dot r = \omega_a` and :math:`\ddot r = \alpha_a` at the first knot.  A chain of
these is continuous in orientation, angular velocity and angular acceleration.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from operator import attrgetter
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, cross, difference, dot, exp, multiply, plus

time_of = attrgetter("time_ns")
"""The key by which to search knots, samples and targets."""

_SEAM = 0.0625  # rad^2, below which a series replaces a quotient that cancels


class Knot(NamedTuple):
    """A pose at an instant, with its first two derivatives.

    Attributes:
        time_ns: when, monotonic clock.
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the body frame, rad/s.
        alpha: its derivative, rad/s^2.
        position: m.
        velocity: m/s.
        acceleration: m/s^2.
    """

    time_ns: int
    q: Quaternion
    omega: Vector3 = ZERO
    alpha: Vector3 = ZERO
    position: Vector3 = ZERO
    velocity: Vector3 = ZERO
    acceleration: Vector3 = ZERO


class Quintic(NamedTuple):
    """A vector that is zero at ``u = 0``, as a polynomial without constant term.

    Attributes:
        c1, c2, c3, c4, c5: coefficients of the powers of *u*.
    """

    c1: Vector3
    c2: Vector3
    c3: Vector3
    c4: Vector3
    c5: Vector3

    def value(self, u: float) -> Vector3:
        """Return the vector at *u*."""
        (a, b, c), (d, e, f), (g, h, i), (j, k, m), (n, o, p) = self
        return (
            u * (a + u * (d + u * (g + u * (j + u * n)))),
            u * (b + u * (e + u * (h + u * (k + u * o)))),
            u * (c + u * (f + u * (i + u * (m + u * p)))),
        )

    def derivatives(self, u: float) -> tuple[Vector3, Vector3, Vector3]:
        """Return the first three derivatives by *u*."""
        c1, c2, c3, c4, c5 = self
        v = u * u
        first = plus(combine(c1, 1.0, c2, 2.0 * u), combine(c3, 3.0, c4, 4.0 * u), v)
        second = combine(c2, 2.0, c3, 6.0 * u)
        third = combine(c3, 6.0, c4, 24.0 * u)
        return (
            plus(first, c5, 5.0 * v * v),
            plus(second, combine(c4, 12.0, c5, 20.0 * u), v),
            plus(third, c5, 60.0 * v),
        )


def quintic(
    way: Vector3, leave: Vector3, bend: Vector3, arrive: Vector3, settle: Vector3
) -> Quintic:
    """Return the polynomial that comes to *way* at 1, with these derivatives by *u*.

    Args:
        way: value at 1.
        leave: first derivative at 0.
        bend: second derivative at 0.
        arrive: first derivative at 1.
        settle: second derivative at 1.
    """
    rows = [
        (
            v,
            0.5 * b,
            10.0 * w - 6.0 * v - 4.0 * a - 1.5 * b + 0.5 * s,
            -15.0 * w + 8.0 * v + 7.0 * a + 1.5 * b - s,
            6.0 * w - 3.0 * v - 3.0 * a - 0.5 * b + 0.5 * s,
        )
        for w, v, b, a, s in zip(way, leave, bend, arrive, settle, strict=True)
    ]
    x, y, z = rows
    c1, c2, c3, c4, c5 = zip(x, y, z, strict=True)
    return Quintic(c1, c2, c3, c4, c5)


def turn_between(here: Knot, there: Knot) -> Quintic:
    """Return the rotation vector from *here* towards *there*, the short way round, rad."""
    span = (there.time_ns - here.time_ns) * 1e-9
    turn = difference(here.q, there.q)
    square = dot(turn, turn)
    # Jacobian 1 - a [r] + b [r]^2, the derivatives of a and b by the angle over the angle, and the
    # factor of [r]^2 in the inverse 1 + [r]/2 + c [r]^2.
    if square < _SEAM:
        b = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0))
        da = -1.0 / 12.0 + square * (1.0 / 180.0 - square / 6720.0)
        db = -1.0 / 60.0 + square * (1.0 / 1260.0 - square / 60480.0)
        c = 1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1209600.0))
    else:
        angle = sqrt(square)
        sine, versine = sin(angle), 1.0 - cos(angle)
        b = (angle - sine) / (angle * square)
        da = (angle * sine - 2.0 * versine) / (square * square)
        db = (angle * versine - 3.0 * (angle - sine)) / (angle * square * square)
        c = (1.0 - 0.5 * angle * sine / versine) / square

    def pulled(v: Vector3) -> Vector3:
        """Return the derivative of the rotation vector for the angular velocity *v*."""
        once = cross(turn, v)
        return plus(plus(v, once, 0.5), cross(turn, once), c)

    arrive = pulled(plus(ZERO, there.omega, span))
    once, along = cross(turn, arrive), dot(turn, arrive)
    change = combine(once, -da * along, cross(turn, once), db * along)
    change = plus(change, cross(arrive, once), b)
    settle = pulled(combine(there.alpha, span * span, change, -1.0))
    leave, bend = plus(ZERO, here.omega, span), plus(ZERO, here.alpha, span * span)
    return quintic(turn, leave, bend, arrive, settle)


def way_between(here: Knot, there: Knot) -> Quintic:
    """Return the way of the position from *here* towards *there*, m."""
    span = (there.time_ns - here.time_ns) * 1e-9
    return quintic(
        plus(there.position, here.position, -1.0),
        plus(ZERO, here.velocity, span),
        plus(ZERO, here.acceleration, span * span),
        plus(ZERO, there.velocity, span),
        plus(ZERO, there.acceleration, span * span),
    )


class Piece:
    """The motion from one knot to the next.

    Attributes:
        here: the first knot.
        there: the second one.
        span: time from one to the other, s.
        turn: rotation vector from the first one, rad.
        way: of the position from the first one, m.
    """

    __slots__ = ("here", "span", "there", "turn", "way")

    def __init__(self, here: Knot, there: Knot) -> None:
        self.here, self.there = here, there
        self.span = (there.time_ns - here.time_ns) * 1e-9
        self.turn = turn_between(here, there)
        self.way = way_between(here, there)

    def at(self, time_ns: int) -> tuple[Quaternion, Vector3]:
        """Return orientation and position, m, at an instant between the knots."""
        u = (time_ns - self.here.time_ns) * 1e-9 / self.span
        q = multiply(self.here.q, exp(self.turn.value(u)))
        return q, plus(self.here.position, self.way.value(u), 1.0)
