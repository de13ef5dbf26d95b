"""A cumulative product, factor after factor, in plain NumPy.

The formulas are those at the head of :mod:`orientd.curves.construct.cumulative`.
"""

import numpy as np

from orientd.curves.construct.basis import bernstein
from orientd.rotation import conjugate, exp_half, multiply, rotate


def sample(curve, times):
    """What :meth:`CumulativeCurve.evaluate` returns at instants inside the domain, ``(n,)``."""
    span = np.searchsorted(curve.knots[1:-1], times, side="right")
    if curve.table is not None:
        return _cubic(curve.table[:, span], times - curve.knots[span])
    breaks, base, axes, lengths, *polynomials = curve.parts
    u = (times - breaks[span]) / (breaks[span + 1] - breaks[span])
    turns = [
        lengths[:, span] * np.einsum("nmd,dn->mn", values[span], bernstein(values.shape[2] - 1, u))
        for values in polynomials
    ]
    return product(base[:, span].T, axes[:, :, span].transpose(0, 2, 1), turns)


def _cubic(constants, t):
    factors = constants[4:].reshape(3, 7, -1)
    a0, a1, a2, a3 = (factors[:, power] for power in range(4))
    turns = [
        a0 + t * (a1 + t * (a2 + t * a3)),
        a1 + t * (2.0 * a2 + t * 3.0 * a3),
        2.0 * a2 + t * 6.0 * a3,
    ]
    return product(constants[:4].T, factors[:, 4:].transpose(0, 2, 1), turns)


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
