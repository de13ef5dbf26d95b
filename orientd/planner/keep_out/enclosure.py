r"""Bounds of the rates of a motion between its records.

Between two records the rotation vector *r* from the first one is a cubic of the share *u* of the
period, plus :math:`\tfrac12 d \max(u - f, 0)^2` at a step *d* of the acceleration
(:mod:`orientd.servo.path.segment`).  So its derivative lies in the hull of three Bernstein
coefficients, and its second derivative is largest at an end.  The step changes value and slope at
the ends if the cubic does not change too.  That moves the derivative by at most *d* / 2 and the
second one by at most 4 *d* / 3.  For the angular velocity and acceleration,

.. math::
    |\omega| \le |\dot r|, \qquad |\alpha| \le |\ddot r| + \tfrac14 |r|\, |\dot r|^2 ,

since the right Jacobian shortens vectors, and since its derivative begins with
:math:`\tfrac16 [\dot r]_\times [r]_\times \dot r`.
"""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats, conjugate, log, multiply, right_jacobian_inverse

LEAST_STEP = 2e-7
"""Least acceleration step that the law between two records knows, rad per squared period."""

_STEP = 13.0
r"""Bound of the step, in sizes of its trace in the records.

The trace is :math:`(d m, d n)` with :math:`m = w - 1/2`, :math:`n = w^2 - 1/3` and *w* from 0 to 1,
whose size is at least *d* / 13.
"""


def rates_between(rows: Floats, period: float) -> tuple[Floats, Floats]:
    """Return proven bounds of the angular velocity and acceleration between records.

    Args:
        rows: orientations, angular velocities (rad/s) and accelerations (rad/s^2) in the body
            frame, shape ``(n, 10)`` or wider.
        period: time between records, s.

    Returns:
        Norms in rad/s and rad/s^2, both of shape ``(n - 1,)``.
    """
    q, omega, alpha = rows[:, :4], period * rows[:, 4:7], period**2 * rows[:, 7:10]
    turn = log(multiply(conjugate(q[:-1]), q[1:]))
    begin, there = omega[:-1], omega[1:]
    end = np.einsum("nij,nj->ni", right_jacobian_inverse(turn), there)
    second, third = 3.0 * turn - 2.0 * begin - end, begin + end - 2.0 * turn
    step = _steps(turn, begin, there, alpha[:-1], alpha[1:] - alpha[:-1])
    speed = np.max([_sizes(begin), _sizes(begin + second), _sizes(end)], axis=0) + 0.5 * step
    bend = np.maximum(2.0 * _sizes(second), 2.0 * _sizes(second + 3.0 * third))
    bend += 4.0 / 3.0 * step + 0.25 * _sizes(turn) * speed**2
    return speed / period, bend / period**2


def _steps(turn: Floats, begin: Floats, end: Floats, alpha: Floats, rise: Floats) -> Floats:
    """Return bounds of the acceleration steps, in rad per squared period."""
    found = end - begin - alpha - 0.5 * rise
    other = 2.0 * (turn - begin) - alpha - rise / 3.0 - np.cross(begin, end) / 6.0
    size = np.hypot(_sizes(found), _sizes(other))
    return np.where(size >= LEAST_STEP, _STEP * size, 0.0)


def _sizes(vectors: Floats) -> Floats:
    found: Floats = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return found
