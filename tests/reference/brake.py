r"""How fast a motion may be slowed down on its own path without breaking a limit.

The servo advances path time at a rate :math:`\sigma \in [0, 1]`.  With the path's own rates
:math:`\omega, \alpha` and jerk :math:`j` at :math:`\sigma = 1`, the device sees

.. math::
    \alpha_t = \alpha \sigma^2 + \omega \dot\sigma, \qquad
    j_t = j \sigma^3 + 3 \alpha \sigma \dot\sigma + \omega \ddot\sigma .

For a brake rate *x* the servo keeps :math:`|\dot\sigma| \le 2x` and :math:`|\ddot\sigma| \le 4x^2`:
a stop from full speed takes :math:`1/x` with a triangular :math:`\dot\sigma`.  Since the rate must
be able to end at 0 and at 1 without passing them, :math:`|\dot\sigma| \le x\,g(\sigma)` with
:math:`g = \min(2, \sqrt{8(1-\sigma)}, \sqrt{8\sigma})`, whatever the sequence of stops, resumptions
and changes of speed.  A point of the path is safe if for every :math:`\sigma`

.. math::
    |\alpha\sigma^2 \pm \omega x g| \le A, \qquad
    |j|\sigma^2 + 3|\alpha|\sigma x g + 4|\omega|x^2 \le J .

(:math:`\sigma^2` for the jerk, where :math:`\sigma^3` would do on a smooth path: a step of the
acceleration, as a C1 curve has at its knots, falls only with the square of the rate.)  Both are
quadratic in *x*.  Near :math:`\sigma = 1` the first one leaves :math:`x \approx \sqrt r A/\omega`
where the acceleration keeps a reserve *r* below *A*: no reserve, no brake.

Why this uniform rate, where the servo usually stops two to ten times as quickly
(:mod:`orientd.servo.brake_law`)?  Because it needs no foresight: it is certified for every point,
for resumptions and changes of speed as for stops, and for a path of which only a little is in the
ring.  The quick law takes in each cycle the least rate that keeps the limits there, which can lead
to a place from which none does; it is used only after it has been rehearsed to rest, cycle by
cycle, over the records at hand.  Considered and left out: a brake rate for each record (one
number would still have to serve a whole stop), and planning the stop beforehand in the daemon
(a stop has to work without one).
"""

from __future__ import annotations

import numpy as np

from orientd.planner.fast import kernels
from orientd.planner.limits import Limits
from orientd.rotation import Floats

FASTEST_BRAKE_RATE = 20.0
"""1/s; a stop never takes less than 50 ms, however slow the motion is."""

SLOWEST_STOP = 4.0
"""Seconds that a stop on the path may take where the timing is the user's."""

_MARGIN = 0.99  # the nodes lie between the worst rates; this covers what they miss
_BLOCK = 512


def _nodes() -> Floats:
    # For a reserve r the worst rate lies at 1 - r/2, so the nodes crowd towards 1.
    return np.concatenate([1.0 - np.geomspace(1e-5, 0.04, 15), np.linspace(0.93, 0.0, 25)])


_SIGMA = _nodes()
_G = np.minimum(2.0, np.sqrt(8.0 * np.minimum(1.0 - _SIGMA, _SIGMA)))
_SIGMA_G = 3.0 * float(np.max(_SIGMA * _G)) * 1.01

# The largest y with (1 - r) sigma^2 + y g <= 1 for all sigma, by the root of r, from below.
_RESERVE_ROOT = np.linspace(0.0, 1.0, 201)
_WORST = _MARGIN * np.min(
    (1.0 - (1.0 - _RESERVE_ROOT[:, None] ** 2) * _SIGMA**2) / _G.clip(1e-12), axis=1
)
_LARGE = 1e12

LAW = (_SIGMA, _G, _WORST, _SIGMA_G, FASTEST_BRAKE_RATE, _MARGIN)
"""What the compiled kernels take of this module."""


def brake_rate(omega: Floats, alpha: Floats, jerk: Floats, limits: Limits) -> tuple[float, int]:
    """Return the largest safe brake rate for the angular part of a path.

    Args:
        omega: angular velocities of the path, rad/s, shape ``(n, 3)``.
        alpha: angular accelerations, rad/s^2, shape ``(n, 3)``.
        jerk: sizes of the angular jerk, rad/s^3, shape ``(n,)``.
        limits: what the device may see.

    Returns:
        The rate in 1/s, in ``[0, FASTEST_BRAKE_RATE]``, and the index of the point that sets it.
    """
    return _least(omega, alpha, jerk, limits.acceleration, limits.jerk)


def axis_brake_rate(
    omega: Floats, alpha: Floats, jerk: Floats, limits: Limits
) -> tuple[float, int]:
    """Return the largest brake rate that is safe for every component in the body frame.

    Every component obeys the inequalities above with its own limits.

    Args:
        omega: angular velocities of the path, rad/s, shape ``(n, 3)``.
        alpha: angular accelerations, rad/s^2, shape ``(n, 3)``.
        jerk: angular jerks, rad/s^3, shape ``(n, 3)``.
        limits: what the device may see.

    Returns:
        As :func:`brake_rate`.
    """
    return min(
        _least(
            omega[:, axis : axis + 1],
            alpha[:, axis : axis + 1],
            np.abs(jerk[:, axis]),
            limits.axis_acceleration[axis],
            limits.axis_jerk[axis],
        )
        for axis in range(3)
    )


def linear_brake_rate(velocity: Floats, acceleration: Floats, limits: Limits) -> tuple[float, int]:
    """Return the largest safe brake rate for the linear part of a path, which has no jerk limit.

    Args:
        velocity: velocities of the position, m/s, shape ``(n, 3)``.
        acceleration: its accelerations, m/s^2, shape ``(n, 3)``.
        limits: what the device may see.

    Returns:
        As :func:`brake_rate`.
    """
    return _least(
        velocity, acceleration, np.zeros(len(velocity)), limits.linear_acceleration, np.inf
    )


def _norm(vectors: Floats) -> Floats:
    norm: Floats = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return norm


def _least(
    velocity: Floats, acceleration: Floats, jerk: Floats, most: float, most_jerk: float
) -> tuple[float, int]:
    """Return the least rate over all points, looking closely only at those that could set it."""
    compiled = kernels().least_rate
    if compiled is not None:
        return compiled(
            velocity,
            acceleration,
            jerk,
            most,
            most_jerk,
            *LAW,
        )
    speed, size = _norm(velocity), _norm(acceleration)
    along = np.abs(np.einsum("ij,ij->i", velocity, acceleration))
    best, place = FASTEST_BRAKE_RATE, 0
    bound = _lower_bound(speed, size, most)
    # The point nearest to its limit first; most others are ruled out by it.
    order = [int(np.argmin(bound)), int(np.argmax(jerk))] if len(speed) else []
    some = np.array(order, dtype=np.intp)
    while len(some):
        rates = _rates(speed[some], size[some], along[some], jerk[some], most, most_jerk)
        index = int(np.argmin(rates))
        if rates[index] < best:
            best, place = float(rates[index]), int(some[index])
        bound[some] = np.inf
        at_risk = (bound < best) | (
            (jerk + _SIGMA_G * size * best + 4.0 * speed * best * best > most_jerk)
            & (bound < np.inf)
        )
        some = np.flatnonzero(at_risk)
        if len(some) > _BLOCK:
            some = some[np.argpartition(bound[some], _BLOCK)[:_BLOCK]]
    return best, place


def _lower_bound(speed: Floats, size: Floats, most: float) -> Floats:
    """Return a rate that the acceleration allows each point, whatever its directions are.

    With both vectors along each other and ``y = x speed / A`` the condition is
    ``(1 - r) sigma^2 + y g <= 1``, whose largest *y* is a function of the reserve *r* alone.
    """
    if not np.isfinite(most):
        return np.full(speed.shape, _LARGE)
    reserve = np.sqrt(np.maximum(1.0 - size / most, 0.0))
    allowed = most * np.interp(reserve, _RESERVE_ROOT, _WORST)
    bound: Floats = np.divide(allowed, speed, out=np.full(speed.shape, _LARGE), where=speed > 0.0)
    bound[size > most] = 0.0
    return bound


def _rates(
    speed: Floats, size: Floats, along: Floats, jerk: Floats, most: float, most_jerk: float
) -> Floats:
    """Return the largest safe rate of each point, shape ``(n,)``."""
    square = _SIGMA[:, None] ** 2
    g = _G[:, None]
    rates = np.full(speed.shape, FASTEST_BRAKE_RATE / _MARGIN)
    # P x^2 + 2 H x <= R: the root in the form that does not cancel.
    if np.isfinite(most):
        rest = most * most - (size * square) ** 2
        half = g * square * along
        rates = np.minimum(rates, _root(rest, half, (g * speed) ** 2))
    if np.isfinite(most_jerk):
        rest = most_jerk - jerk * square
        half = 1.5 * _SIGMA[:, None] * g * size
        rates = np.minimum(rates, _root(rest, half, 4.0 * speed))
    is_hopeless = (size > most) | (jerk > most_jerk)
    safe: Floats = np.where(is_hopeless, 0.0, _MARGIN * rates)
    return safe


def _root(rest: Floats, half: Floats, leading: Floats) -> Floats:
    rest = np.maximum(rest, 0.0)
    divisor = half + np.sqrt(half * half + leading * rest)
    roots = np.divide(rest, divisor, out=np.full(divisor.shape, np.inf), where=divisor > 0.0)
    least: Floats = roots.min(axis=0)
    return least
