r"""The path between two records: one law for the servo and for the certificate.

With the rotation vector *r* from the first record, and *u* in [0, 1] the share of the period *h*,

.. math::
    q(u) = q_a \exp(r(u)), \qquad r(u) = c_1 u + c_2 u^2 + c_3 u^3 + \tfrac12 d \max(u - f, 0)^2,

where :math:`r(1) = \log(q_a^{-1} q_b)`.  The angular velocities of both records give :math:`r'(0) =
h\omega_a` and :math:`r'(1) = J_r(r(1))^{-1} h\omega_b`.  So orientation and angular velocity are
those of the records, and the error on a smooth path is of fourth order in the period. At ``u = 0``
the result is the record itself, without rounding.

The step *d* is zero on a smooth path.  A path of continuity 1 has acceleration steps at its knots,
at any place between two cycles.  Let the acceleration have a step *d* at the share *f* of the
period, and otherwise change linearly, by *e* over the period.  With :math:`w = 1 - f` and all rates
per period, orientation, velocity and acceleration of the two records satisfy

.. math::
    \alpha_b - \alpha_a &= d + e, \\
    \omega_b - \omega_a - \alpha_a &= d w + e / 2, \\
    2 (\theta - \omega_a) - \alpha_a &= d w^2 + e / 3,

from which *d* and *w* follow.

The file ``kernels/c/between.h`` has the same law with the same order of operations.

If the path has joints of the device, they are cubic Hermite polynomials of the angles and
velocities of both records.
"""

from __future__ import annotations

from math import copysign, cos, inf, sin, sqrt
from typing import Any, NamedTuple

from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.floats import combine, difference, multiply, plus
from orientd.stream.records import JOINTS

LEAST_STEP = 2e-7
"""Least acceleration step that is detected, rad per squared period."""

AT_RECORD = 1e-6
"""A step of the acceleration this close to a record, in periods, is at the record.

So rounding does not decide which of two places explains the records.
"""

_SEAM = 0.0625  # rad^2, below which a series replaces the quotient that cancels


class PathPoint(NamedTuple):
    """A point of the path with its derivatives by path time.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega_body: angular velocity, rad/s.
        alpha_body: angular acceleration, rad/s^2.
        position: m.
        velocity: m/s.
        joints: angles of the device's axes, rad; empty if the path has none.
        joint_velocities: their derivatives at a record, rad/s; empty between two.
    """

    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3
    position: Vector3
    velocity: Vector3
    joints: Joints = ()
    joint_velocities: Joints = ()


def point_of(record: tuple[Any, ...]) -> PathPoint:
    """Return the point of a path record, given by its fields in order."""
    # Neither slices nor a call of PathPoint(): this runs in every cycle.
    _, w, x, y, z, a, b, c, d, e, f, p, q, r, s, t, u, *axes = record
    joints: Joints = ()
    rates: Joints = ()
    if axes[0] == axes[0]:  # a number: there are axes
        count = JOINTS
        while axes[count - 1] != axes[count - 1]:
            count -= 1
        joints, rates = tuple(axes[:count]), tuple(axes[JOINTS : JOINTS + count])
    parts = (w, x, y, z), (a, b, c), (d, e, f), (p, q, r), (s, t, u), joints, rates
    return tuple.__new__(PathPoint, parts)


class Law(NamedTuple):
    """A vector between two records as a function of the share *u* of the period.

    Attributes:
        first: coefficient of *u*.
        second: coefficient of the square of *u*.
        third: coefficient of its third power.
        step: step of the second derivative, at *place*.
        place: share of the period at which the step is.
    """

    first: Vector3
    second: Vector3
    third: Vector3
    step: Vector3 = ZERO
    place: float = 1.0

    def value(self, u: float) -> Vector3:
        """Return the vector at *u*, which is zero at 0."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), place = self
        over = u - place
        bend = 0.5 * over * over if over > 0.0 else 0.0
        return (
            u * (ax + u * (bx + u * cx)) + bend * dx,
            u * (ay + u * (by + u * cy)) + bend * dy,
            u * (az + u * (bz + u * cz)) + bend * dz,
        )

    def rate(self, u: float) -> Vector3:
        """Return the derivative of the vector by *u*."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), place = self
        over, two, three = max(u - place, 0.0), 2.0 * u, 3.0 * u * u
        return (
            ax + two * bx + three * cx + over * dx,
            ay + two * by + three * cy + over * dy,
            az + two * bz + three * cz + over * dz,
        )


def hermite(way: Vector3, leave: Vector3, arrive: Vector3) -> Law:
    """Return the cubic that reaches *way* with the derivatives *leave* at 0 and *arrive* at 1."""
    (ax, ay, az), (bx, by, bz), (x, y, z) = leave, arrive, way
    return Law(
        leave,
        (3.0 * x - 2.0 * ax - bx, 3.0 * y - 2.0 * ay - by, 3.0 * z - 2.0 * az - bz),
        (ax + bx - 2.0 * x, ay + by - 2.0 * y, az + bz - 2.0 * z),
    )


def law_between(start: PathPoint, end: PathPoint, period: float) -> Law:
    """Return the rotation vector from one record towards the next, rad."""
    x, y, z = turn = difference(start.q, end.q)
    a, b, c = start.omega_body
    vx, vy, vz = leave = (period * a, period * b, period * c)
    a, b, c = end.omega_body
    wx, wy, wz = (period * a, period * b, period * c)
    # J_r(r)^-1 w: a series up to the twentieth order, for turns below half a turn.
    square = x * x + y * y + z * z
    factor = 1.0 / 12.0 + square * (
        1.0 / 720.0
        + square * (1.0 / 30240.0 + square * (1.0 / 1209600.0 + square * (1.0 / 47900160.0)))
    )
    e, f, g = (y * wz - z * wy, z * wx - x * wz, x * wy - y * wx)
    arrive = (
        wx + 0.5 * e + factor * (y * g - z * f),
        wy + 0.5 * f + factor * (z * e - x * g),
        wz + 0.5 * g + factor * (x * f - y * e),
    )
    cubic = hermite(turn, leave, arrive)

    # The equations without the linear change: s = d (w - 1/2) and t = d (w^2 - 1/3).
    area = period * period
    a, b, c = start.alpha_body
    e, f, g = end.alpha_body
    a, b, c = area * a, area * b, area * c
    e, f, g = rise = (area * e - a, area * f - b, area * g - c)
    s = sx, sy, sz = (wx - vx - a - 0.5 * e, wy - vy - b - 0.5 * f, wz - vz - c - 0.5 * g)
    # The velocities do not commute: their common turn lacks a twelfth of their product.
    third, sixth = 1.0 / 3.0, 1.0 / 6.0
    t = tx, ty, tz = (
        2.0 * (x - vx) - a - third * e - sixth * (vy * wz - vz * wy),
        2.0 * (y - vy) - b - third * f - sixth * (vz * wx - vx * wz),
        2.0 * (z - vz) - c - third * g - sixth * (vx * wy - vy * wx),
    )
    ss, tt = sx * sx + sy * sy + sz * sz, tx * tx + ty * ty + tz * tz
    if not max(ss, tt) >= LEAST_STEP * LEAST_STEP:
        return cubic
    return _bent(cubic, s, t, rise, ss, sx * tx + sy * ty + sz * tz, tt)


def _bent(
    cubic: Law, s: Vector3, t: Vector3, rise: Vector3, ss: float, st: float, tt: float
) -> Law:
    """Return a cubic with the acceleration step that explains its records, if there is one."""
    over, under = (st, ss) if ss > tt else (tt, st)
    # The roots of under w^2 - over w + over / 2 - under / 3, in the form that does not cancel.
    root = sqrt((over - under) * (over - under) + under * under * (1.0 / 3.0))
    total = 0.5 * (over + copysign(root, over))
    places = (total / under if under else inf, (0.5 * over - 1.0 / 3.0 * under) / total)
    # Two places explain the same records; the change between the steps tells which one is right.
    found: tuple[float, float, Vector3] | None = None
    for w in places:
        if -AT_RECORD <= w <= 1.0 + AT_RECORD:
            m, n = w - 0.5, w * w - 1.0 / 3.0
            scale = 1.0 / (m * m + n * n)
            m, n = m * scale, n * scale
            step = x, y, z = (m * s[0] + n * t[0], m * s[1] + n * t[1], m * s[2] + n * t[2])
            x, y, z = rise[0] - x, rise[1] - y, rise[2] - z
            gap = x * x + y * y + z * z
            if found is None or gap < found[0]:
                found = gap, w, step
    if found is None:
        return cubic
    _, w, step = found
    w = min(max(w, 0.0), 1.0)
    x, y, z = step
    # Correct the cubic, so that value and slope at the end stay the same.
    b, c = w * (1.0 - 1.5 * w), w * (w - 1.0)
    (bx, by, bz), (cx, cy, cz) = cubic.second, cubic.third
    second = (bx + b * x, by + b * y, bz + b * z)
    return Law(cubic.first, second, (cx + c * x, cy + c * y, cz + c * z), step, 1.0 - w)


STANDING = Law(ZERO, ZERO, ZERO)


class JointLaw(NamedTuple):
    """The angle of an axis between two records as a function of the share *u* of the period.

    It is the cubic with the angles and the velocities of both records, as a polynomial.

    Attributes:
        angle: at 0, rad.
        first: coefficient of *u*, rad.
        second: coefficient of the square of *u*, rad.
        third: coefficient of its third power, rad.
    """

    angle: float
    first: float
    second: float
    third: float

    def rate(self, u: float) -> float:
        """Return the derivative of the angle by *u*, rad."""
        _, a, b, c = self
        return a + u * (2.0 * b + 3.0 * u * c)


def joint_laws(start: PathPoint, end: PathPoint, period: float) -> list[JointLaw]:
    """Return the law of every axis from one record to the next."""
    laws = []
    for angle, goal, rate, last in zip(
        start.joints, end.joints, start.joint_velocities, end.joint_velocities, strict=True
    ):
        way, leave, arrive = goal - angle, period * rate, period * last
        second, third = 3.0 * way - 2.0 * leave - arrive, leave + arrive - 2.0 * way
        laws.append(JointLaw(angle, leave, second, third))
    return laws


def joints_at(laws: list[JointLaw], u: float) -> Joints:
    """Return the angles of the axes at the share *u* of the period, rad."""
    return tuple([angle + u * (a + u * (b + u * c)) for angle, a, b, c in laws])


class Segment:
    """The path between two neighbouring records, *period* seconds of path time apart.

    Attributes:
        turn: rotation vector from the first of them, rad.
        travel: distance of the position, m.
        joints: of every axis, rad; empty if the path has none.
    """

    __slots__ = ("_end", "_period", "_start", "joints", "travel", "turn")

    def __init__(self, start: PathPoint, end: PathPoint, period: float) -> None:
        self._start = start
        self._end = end
        self._period = period
        self.turn = law_between(start, end, period)
        self.joints = joint_laws(start, end, period)
        self.travel = STANDING
        p, q = start.position, end.position
        if p != q or not start.velocity == end.velocity == ZERO:
            x, y, z = start.velocity
            u, v, w = end.velocity
            self.travel = hermite(
                (q[0] - p[0], q[1] - p[1], q[2] - p[2]),
                (period * x, period * y, period * z),
                (period * u, period * v, period * w),
            )

    def at(self, u: float) -> PathPoint:
        """Return the point at the share *u* of the period, in [0, 1)."""
        start, h = self._start, self._period
        if u == 0.0:
            return start
        x, y, z = self.turn.value(u)
        vx, vy, vz = self.turn.rate(u)
        square = x * x + y * y + z * z
        angle = sqrt(square)
        half = 0.5 * angle
        c = cos(half)
        s = sin(half) / angle if angle > 0.0 else 0.5
        q = multiply(start.q, (c, s * x, s * y, s * z))
        # J_r(r) v = v - a r x v + b r x (r x v)
        a = 2.0 * s * s
        if square < _SEAM:
            b = 1.0 / 6.0 + square * (
                -1.0 / 120.0
                + square * (1.0 / 5040.0 + square * (-1.0 / 362880.0 + square * (1.0 / 39916800.0)))
            )
        else:
            b = (1.0 - 2.0 * s * c) / square
        e, f, g = (y * vz - z * vy, z * vx - x * vz, x * vy - y * vx)
        omega = (
            (vx - a * e + b * (y * g - z * f)) / h,
            (vy - a * f + b * (z * e - x * g)) / h,
            (vz - a * g + b * (x * f - y * e)) / h,
        )
        alpha = combine(start.alpha_body, 1.0 - u, self._end.alpha_body, u)
        joints = joints_at(self.joints, u)
        if self.travel is STANDING:
            return PathPoint(q, omega, alpha, start.position, start.velocity, joints)
        position = plus(start.position, self.travel.value(u), 1.0)
        velocity = plus(ZERO, self.travel.rate(u), 1.0 / h)
        return PathPoint(q, omega, alpha, position, velocity, joints)
