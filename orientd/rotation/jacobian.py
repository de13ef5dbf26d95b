r"""The right Jacobian of the exponential map of SO(3), and its inverse.

For a rotation vector :math:`r(t)` and :math:`q = \exp(r)`, the angular velocity in body components
is :math:`J_r(r)\,r'`.  In world components it is :math:`J_l(r)\,r'`, and the left Jacobian
:math:`J_l(r) = J_r(-r)` is the transpose.  Near zero, the coefficients use the sine of half the
angle.  A Taylor polynomial replaces differences of nearly equal numbers, which would lose digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation.quaternion import Floats, components

_SEAM = 0.25
"""Below this angle (rad) a Taylor polynomial is used; both forms agree to 1e-15 there."""

_SINE_TERMS = (1 / 6, -1 / 120, 1 / 5040, -1 / 362880, 1 / 39916800, -1 / 6227020800)
_INVERSE_TERMS = (
    *(1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160),
    *(691 / 1307674368000, 1 / 74724249600),
)


def right_jacobian(rotation_vector: ArrayLike) -> Floats:
    r"""Return the matrices that take the rate of a rotation vector to the body angular velocity.

    .. math:: J_r(r) = I - \frac{1 - \cos\theta}{\theta^2} [r]_\times
              + \frac{\theta - \sin\theta}{\theta^3} [r]_\times^2

    (Bullo and Murray, 1995; also Sola, Deray and Atchuthan, 2018, eq. 143.)

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    r = components(rotation_vector, 3, "rotation_vector")
    square = np.sum(r * r, axis=-1)
    half_sinc = np.sinc(np.sqrt(square) / (2.0 * np.pi))
    first = -0.5 * half_sinc * half_sinc
    second = _coefficient(square, _SINE_TERMS, lambda theta: (theta - np.sin(theta)) / theta**3)
    return _matrix(r, first, second)


def right_jacobian_inverse(rotation_vector: ArrayLike) -> Floats:
    r"""Return the matrices that take the body angular velocity to the rate of a rotation vector.

    .. math:: J_r^{-1}(r) = I + \tfrac12 [r]_\times
              + \frac{1 - \tfrac{\theta}{2} \cot\tfrac{\theta}{2}}{\theta^2} [r]_\times^2

    It exists for every angle but whole turns other than zero.  Near a whole turn its entries grow
    without bound, and at one they are meaningless.

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    r = components(rotation_vector, 3, "rotation_vector")
    square = np.sum(r * r, axis=-1)
    return _matrix(r, np.array(0.5), _coefficient(square, _INVERSE_TERMS, _inverse_coefficient))


def _matrix(r: Floats, first: Floats, second: Floats) -> Floats:
    """Return ``I + first [r] + second [r]^2``."""
    x, y, z = r[..., 0], r[..., 1], r[..., 2]
    cross: Floats = np.zeros((*r.shape[:-1], 3, 3))
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    cross[..., 1, 0], cross[..., 2, 0], cross[..., 2, 1] = z, -y, x
    matrix: Floats = (
        np.eye(3) + first[..., None, None] * cross + second[..., None, None] * (cross @ cross)
    )
    return matrix


def _coefficient(
    square: Floats, terms: tuple[float, ...], exact: Callable[[Floats], Floats]
) -> Floats:
    """Return a coefficient: a polynomial in the *square* of small angles, else *exact*."""
    theta = np.sqrt(square)
    is_small = theta < _SEAM
    series = np.polynomial.polynomial.polyval(np.where(is_small, square, 0.0), terms)
    return np.where(is_small, series, exact(np.where(is_small, 1.0, theta)))


def _inverse_coefficient(theta: Floats) -> Floats:
    half = 0.5 * theta
    return (1.0 - half * np.cos(half) / np.sin(half)) / theta**2
