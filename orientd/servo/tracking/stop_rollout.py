r"""How near a stop comes to the keep-out cones, in closed form.

The quickest stop (:func:`orientd.servo.motion_law.halt`) takes the acceleration straight to a
turning point :math:`\alpha_1`, holds it there, and takes it straight to zero:

.. math::
    \omega_0 + T_1 \frac{\alpha_0 + \alpha_1}{2} + T_2\, \alpha_1 + T_3 \frac{\alpha_1}{2} = 0,
    \qquad T_1 = \frac{|\alpha_1 - \alpha_0|}{J}, \quad T_3 = \frac{|\alpha_1|}{J}.

So :math:`\alpha_1` points against :math:`\omega_0 + T_1 \alpha_0 / 2`, and :math:`T_1` is the root
of one equation.  The first phase is split into turns about fixed axes (the first two terms of the
Magnus series).  The others are one turn, since velocity and acceleration are parallel then.  During
such a turn the cosine of the angle between the tool's axis and a direction
is :math:`k_0 + k_1 \cos s + k_2 \sin s`, so its largest value is known exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import acos, atan2, ceil, cos, inf, sin, sqrt, tau
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, cross, dot, norm, plus
from orientd.servo.motion_law import TrackingLimits, times

_LONGEST = 0.3
"""Largest angle of a single turn, rad: the series leaves out the third order."""

_ROUNDS = 8
"""Iterations for the duration of the first phase."""


class Arc:
    """The cosine between an axis that turns about *u* and a direction, over the angle of the turn.

    Args:
        p: unit vector that turns.
        u: unit vector of the axis of the turn.
        d: unit vector of the direction.
    """

    __slots__ = ("k0", "k1", "k2")

    def __init__(self, p: Vector3, u: Vector3, d: Vector3) -> None:
        # Written out: a cycle near cones needs some twenty of them.
        x, y, z = p
        a, b, c = u
        e, f, g = d
        self.k0 = (a * x + b * y + c * z) * (a * e + b * f + c * g)
        self.k1 = x * e + y * f + z * g - self.k0
        self.k2 = (b * z - c * y) * e + (c * x - a * z) * f + (a * y - b * x) * g

    def at(self, angle: float) -> float:
        """Return the cosine after a turn by *angle*."""
        return self.k0 + self.k1 * cos(angle) + self.k2 * sin(angle)

    def largest(self, angle: float) -> float:
        """Return its largest value on a turn by *angle*, at most 2 pi, without the beginning."""
        top = atan2(self.k2, self.k1)
        if (top if top >= 0.0 else top + tau) < angle:
            return self.k0 + sqrt(self.k1 * self.k1 + self.k2 * self.k2)
        return self.at(angle)

    def first(self, cosine: float) -> float:
        """Return the angle at which *cosine* is reached from below; zero if it is exceeded."""
        height = sqrt(self.k1 * self.k1 + self.k2 * self.k2)
        if self.k0 + self.k1 >= cosine:
            return 0.0
        share = (cosine - self.k0) / height
        return max(atan2(self.k2, self.k1) % tau - acos(min(share, 1.0)), 0.0)


def stop_turns(
    omega: Vector3, alpha: Vector3, limits: TrackingLimits, units: Vector3
) -> Iterator[tuple[Vector3, float]]:
    """Yield the turns of the quickest stop: unit axes in the body frame, and angles in rad.

    The first one begins at the setpoint before the one that *omega* and *alpha* lead to.

    Args:
        omega: angular velocity of the last step, in *units*.
        alpha: angular acceleration of the last two steps, in *units*.
        limits: limits in *units*.
        units: see :func:`~orientd.servo.motion_law.limits_of`.
    """
    most, jerk, h = limits.acceleration, limits.jerk, limits.period
    # Between samples the velocity is that of half a cycle before.
    omega = plus(omega, alpha, -0.5 * h)
    # The duration of the first phase.  Once it is about known, plain steps may swing, halved ones
    # contract.
    first, share = 0.0, 1.0
    for _ in range(_ROUNDS):
        goal = plus(omega, alpha, 0.5 * first)
        size, ramp = norm(goal), jerk * first
        peak = min(0.5 * (sqrt(ramp * ramp + 8.0 * jerk * size) - ramp), most)
        bend = plus(ZERO, goal, -peak / size) if size > 1e-12 else ZERO
        change = plus(bend, alpha, -1.0)
        found = norm(change) / jerk
        if abs(found - first) < 1e-3 * h:
            break
        first += share * (found - first)
        share = 0.5
    held = max(size / peak - 0.5 * first - 0.5 * peak / jerk, 0.0) if peak >= most else 0.0
    if first > 0.0:
        ramp_rate = plus(ZERO, change, 1.0 / first)
        yield from _turns(omega, alpha, ramp_rate, first, units)
        omega = plus(plus(omega, alpha, first), ramp_rate, 0.5 * first * first)
    last = peak / jerk
    angle = held * (norm(omega) - 0.5 * peak * held) + peak * last * last / 6.0
    if angle > 0.0:
        turn = times(plus(ZERO, goal, angle / size), units)
        angle = norm(turn)
        yield plus(ZERO, turn, 1.0 / angle), angle


def _turns(
    omega: Vector3, alpha: Vector3, jerk: Vector3, seconds: float, units: Vector3
) -> Iterator[tuple[Vector3, float]]:
    """Yield the turns of a phase of constant *jerk*."""
    end = plus(plus(omega, alpha, seconds), jerk, 0.5 * seconds * seconds)
    count = ceil(0.5 * (norm(omega) + norm(end)) * seconds / _LONGEST) or 1
    t = seconds / count
    for _ in range(count):
        following = plus(plus(omega, alpha, t), jerk, 0.5 * t * t)
        turn = plus(combine(omega, t, alpha, 0.5 * t * t), jerk, t * t * t / 6.0)
        turn = plus(
            times(turn, units), cross(times(omega, units), times(following, units)), t * t / 12.0
        )
        angle = norm(turn)
        if angle > 0.0:
            yield plus(ZERO, turn, 1.0 / angle), angle
        omega, alpha = following, plus(alpha, jerk, t)


class Obstacle(NamedTuple):
    """A direction that an axis of the tool must not come near to.

    Attributes:
        axis: unit vector in the frame of the tool.
        direction: unit vector, in the frame of the tool at the beginning.
        angle: least angle between the two, rad.
    """

    axis: Vector3
    direction: Vector3
    angle: float


def least_margin(turns: Iterator[tuple[Vector3, float]], obstacles: Sequence[Obstacle]) -> float:
    """Return by how much successive *turns* of the tool stay clear of *obstacles*, rad.

    The beginning does not count.  Without any turn the result is infinite.
    """
    nearest = [-inf] * len(obstacles)
    directions = [one.direction for one in obstacles]
    for u, angle in turns:
        for place, (axis, _, _) in enumerate(obstacles):
            d = directions[place]
            nearest[place] = max(nearest[place], Arc(axis, u, d).largest(angle))
            # The direction turns the other way in the frame of the tool.
            directions[place] = rotated(d, u, -angle)
    return min(
        acos(min(cosine, 1.0)) - one.angle if cosine >= -1.0 else inf
        for cosine, one in zip(nearest, obstacles, strict=True)
    )


def rotated(v: Vector3, u: Vector3, angle: float) -> Vector3:
    """Return *v* turned by *angle* about the unit vector *u*."""
    c, s = cos(angle), sin(angle)
    return plus(combine(v, c, cross(u, v), s), u, dot(u, v) * (1.0 - c))
