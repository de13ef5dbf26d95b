"""What the servo draws between records, all records of a path at once, in plain NumPy."""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats, conjugate, exp, log, multiply, right_jacobian_inverse

_LEAST_STEP = 2e-7


def drawn(rows: Floats, period: float, u: float) -> Floats:
    """Return the orientation a share *u* of the way from each record to the next.

    Args:
        rows: orientation, angular velocity and acceleration of records, shape ``(n, 10)``.
        period: from one to the next, s.
        u: in (0, 1).

    Returns:
        Shape ``(n - 1, 4)``.
    """
    q = rows[:, :4]
    r = log(multiply(conjugate(q[:-1]), q[1:]))
    v, w = period * rows[:-1, 4:7], period * rows[1:, 4:7]
    a, b = period**2 * rows[:-1, 7:], period**2 * rows[1:, 7:]
    arrive = np.einsum("nij,nj->ni", right_jacobian_inverse(r), w)
    angle = u * u * (3 - 2 * u) * r + u * (1 - u) * ((1 - u) * v - u * arrive)
    rise = b - a
    s = w - v - a - rise / 2
    t = 2 * (r - v) - np.cross(v, w) / 6 - a - rise / 3
    for k in range(len(r)):
        angle[k] += _bend(s[k], t[k], rise[k], u)
    return multiply(q[:-1], exp(angle))


def _bend(s: Floats, t: Floats, rise: Floats, u: float) -> Floats:
    """Return what a step of the acceleration adds, as of ``servo.path.segment``."""
    if not max(s @ s, t @ t) >= _LEAST_STEP**2:
        return np.zeros(3)
    # s (w^2 - 1/3) = t (w - 1/2), along the larger of the two.
    along = s if s @ s > t @ t else t
    places = np.roots([along @ s, -(along @ t), 0.5 * (along @ t) - (along @ s) / 3.0])
    found = [(np.inf, 0.0, np.zeros(3))]
    for w in places[np.isreal(places)].real:
        if 0.0 <= w <= 1.0:
            share = np.array([w - 0.5, w * w - 1 / 3])
            step = share @ np.stack([s, t]) / (share @ share)
            found.append((float(np.sum((rise - step) ** 2)), float(w), step))
    _, w, step = min(found, key=lambda each: each[0])
    over = max(u - 1 + w, 0.0)
    return (0.5 * over * over - u * u * w * (0.5 * w * (3 - 2 * u) - 1 + u)) * step
