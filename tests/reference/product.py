"""A cumulative product, factor after factor, in plain NumPy.

The formulas are those at the head of :mod:`orientd.curves.products`; velocity and acceleration
follow factor by factor (Sommer et al., 2020).
"""

import numpy as np
from scipy.interpolate import BPoly

from orientd.rotation import conjugate, exp_half, multiply, rotate


def sample(curve, times):
    """What :meth:`Curve.evaluate` returns of a product at instants inside the domain, ``(n,)``."""
    base, first, increments, values = curve.parts
    span = np.searchsorted(curve.knots[1:-1], times, side="right")
    start, width = curve.knots[span], np.diff(curve.knots)[span]
    turns = np.empty((3, values.shape[1], len(times)))
    for s in np.unique(span):
        here = span == s
        for f in range(values.shape[1]):
            polynomial = BPoly(values[s, f][:, None], [0.0, 1.0])
            for order in range(3):
                part = polynomial((times[here] - start[here]) / width[here], nu=order)
                turns[order, f, here] = part / width[here] ** order
    w = increments[first[span][:, None] + np.arange(values.shape[1])]
    lengths = np.linalg.norm(w, axis=2)
    axes = w / np.where(lengths > 0.0, lengths, 1.0)[..., None]
    return product(base[span], axes.transpose(1, 0, 2), turns * lengths.T)


def product(base, axes, turns):
    """Orientation, velocity and acceleration of a product of turns about fixed axes.

    Args:
        base: the quaternions before the product, shape ``(n, 4)``.
        axes: unit axes of the factors, shape ``(m, n, 3)``.
        turns: half angles of the factors with first and second time derivatives, ``(3, m, n)``.
    """
    q, omega, alpha = base, np.zeros((len(base), 3)), np.zeros((len(base), 3))
    for axis, angle, rate, curvature in zip(axes, *turns, strict=True):
        turn = exp_half(angle[:, None] * axis)
        q = multiply(q, turn)
        omega, alpha = rotate(conjugate(turn), omega), rotate(conjugate(turn), alpha)
        own = 2.0 * rate[:, None] * axis
        alpha = alpha + np.cross(omega, own) + 2.0 * curvature[:, None] * axis
        omega = omega + own
    return q, omega, alpha
