r"""How fast a motion can slow down on its own path without breaking a limit.

The servo advances path time at a rate :math:`\sigma \in [0, 1]`.  With the path's own rates
:math:`\omega, \alpha` and jerk :math:`j` at :math:`\sigma = 1`, the device sees

.. math::
    \alpha_t = \alpha \sigma^2 + \omega \dot\sigma, \qquad
    j_t = j \sigma^3 + 3 \alpha \sigma \dot\sigma + \omega \ddot\sigma .

For a brake rate *x* the servo keeps :math:`|\dot\sigma| \le 2x` and :math:`|\ddot\sigma| \le 4x^2`.
A stop from full speed takes :math:`1/x` with a triangular :math:`\dot\sigma`.  The rate must be
able to end at 0 and at 1 without overshoot, after any sequence of stops, resumptions and changes of
speed.  Therefore :math:`|\dot\sigma| \le x\,g(\sigma)` with :math:`g = \min(2, \sqrt{8(1-\sigma)},
\sqrt{8\sigma})`.  A point of the path is safe if for every :math:`\sigma`

.. math::
    |\alpha\sigma^2 \pm \omega x g| \le A, \qquad
    |j|\sigma^2 + 3|\alpha|\sigma x g + 4|\omega|x^2 \le J .

On a smooth path, the jerk would fall with :math:`\sigma^3`.  But an acceleration step, as C1 curves
have at their knots, falls only with :math:`\sigma^2`.  Both inequalities are quadratic in *x*.
Near :math:`\sigma = 1` the first one leaves :math:`x \approx \sqrt r A/\omega` if the acceleration
keeps a reserve *r* below *A*.  Without a reserve the motion cannot brake.

At full speed the device's differences average the acceleration over a period, at a lower speed
over less.  So it sees of :math:`\alpha\sigma^2` at a rate no more than the least of three bounds.
All of them are proven for every phase, and for every rate up to the one in question:

- the certified bound of the differences there;
- :math:`\sigma^2` times the largest acceleration of the path around;
- :math:`\sigma^2` times a sum: the bound for the rate 1, plus :math:`1 - \sigma` times a third of
  the jerk and :math:`1 / (2 + 2 \sigma)` of the steps of the acceleration.  A second difference is
  a mean of the acceleration, weighted with a hat.  A narrower hat can change it by that much.

The velocity is its largest value in the period.  The product of both vectors at the full rate, and
the jerk, are those at the record and at three phases behind it.  The position and the axes of the
device obey the same inequalities with their own velocity, acceleration and limits.  For an axis and
for a component the product is that of the bounds, so only the jerk is sampled.

The servo usually stops two to ten times as fast (:mod:`orientd.servo.path.quick_stop`).  The
uniform rate is needed because it requires no prediction.  It is certified for every point, for
resumptions and changes of speed as well as stops, and for a path of which the ring holds only a
little.  The quick law takes the least feasible rate in each cycle, which can lead to a point
without a feasible rate.  The servo therefore uses it only after it has simulated the stop to rest
over the records that it has.  Two alternatives were rejected.  With a brake rate per record, one
number would still have to serve a whole stop.  And a stop must work without the daemon, so the
daemon cannot plan it beforehand.
"""

from __future__ import annotations

import numpy as np

from orientd import kernels
from orientd.model.limits import Limits
from orientd.rotation import Floats

FASTEST_BRAKE_RATE = 20.0
"""Largest brake rate, 1/s; a stop never takes less than 50 ms, however slow the motion is."""

_USUAL_STOP, LONGEST_STOP = 6.0, 24.0
"""Longest stop on a long motion, s, and its maximum on a device that is slow to stop.

The servo reads this much of a path ahead.
"""

_SLOWER_STOP = 7.2
"""Factor by which a stop beyond the usual one may exceed a stop with the full limits."""

_SLOWER_END = 5.0
"""Factor by which a stop may exceed the run-up to an end velocity, however long this is."""

_MARGIN = 0.99  # covers the worst rates, which lie between the nodes


def _nodes() -> Floats:
    # For a reserve r the worst rate is 1 - r/2, so the nodes are densest near 1.
    return np.concatenate([1.0 - np.geomspace(1e-5, 0.04, 15), np.linspace(0.93, 0.0, 25)])


_SIGMA = _nodes()
_G = np.minimum(2.0, np.sqrt(8.0 * np.minimum(1.0 - _SIGMA, _SIGMA)))
_SIGMA_G = 3.0 * float(np.max(_SIGMA * _G)) * 1.01

# The largest y with (1 - r) sigma^2 + y g <= 1 for all sigma, by the root of r, rounded down.
_RESERVE_ROOT = np.linspace(0.0, 1.0, 201)
_WORST = _MARGIN * np.min(
    (1.0 - (1.0 - _RESERVE_ROOT[:, None] ** 2) * _SIGMA**2) / _G.clip(1e-12), axis=1
)

_LAW = np.stack([_SIGMA, _G]), _WORST


def law(fastest: float) -> tuple[Floats, Floats, Floats]:
    """Return the constants of this module for the kernel, which returns no rate above *fastest*."""
    return *_LAW, np.array([_SIGMA_G, fastest, _MARGIN])


def longest_stop(seconds: float) -> float:
    """Return the longest allowed stop on a long motion, s.

    Args:
        seconds: duration of a stop with the full limits.
    """
    return min(max(_USUAL_STOP, _SLOWER_STOP * seconds), LONGEST_STOP)


def longest_stop_from(speed: float, limits: Limits) -> float:
    """Return the longest allowed stop on a motion of a given velocity, rad/s, in s."""
    return longest_stop(_rise_time(speed, limits))


def longest_stop_beside(end_speed: float, limits: Limits) -> float:
    """Return the stop that a given velocity at an end allows at least, rad/s, in s.

    Before and after the motion the device needs almost its full acceleration to reach it.
    """
    return _SLOWER_END * _rise_time(end_speed, limits)


def _rise_time(speed: float, limits: Limits) -> float:
    return kernels.stop_along(speed, 0.0, limits.acceleration, limits.jerk)[0]


def speed_to_stop(shares: Floats, stop_time: float) -> Floats:
    """Return the velocities from which a stop on the path takes a given time, over acceleration, s.

    Args:
        shares: of the acceleration that the path uses in its own direction.
        stop_time: s.
    """
    roots = np.sqrt(np.maximum(1.0 - shares, 0.0))
    found: Floats = stop_time * np.interp(roots, _RESERVE_ROOT, _WORST)
    return found


def jerk_to_stop(velocity: Floats, acceleration: Floats, stop_time: float) -> Floats:
    """Return the jerk that a stop on the path adds to its own, rad/s^3.

    Args:
        velocity: of the path, rad/s.
        acceleration: of the path, rad/s^2.
        stop_time: s.
    """
    rate = 1.0 / stop_time
    return _SIGMA_G * acceleration * rate + 4.0 * velocity * rate**2
