r"""The Jacobians of the exponential map of SO(3), and their inverses.

For a rotation vector :math:`r(t)` and :math:`q = \exp(r)`, the angular velocity in world
components is :math:`J_l(r)\,r'`, and in body components :math:`J_r(r)\,r'`, with
:math:`J_r(r) = J_l(-r) = J_l(r)^T`.  Coefficients near zero are written with the sine of half the
angle, or a Taylor polynomial where the difference of nearly equal numbers would lose digits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation.quaternion import Floats, components

_SEAM = 0.25
"""Below this angle (rad) a Taylor polynomial is used; both forms agree to 1e-15 there."""


def _skew(v: Floats) -> Floats:
    matrix: Floats = np.zeros((*v.shape[:-1], 3, 3))
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def _horner(x: Floats, coefficients: tuple[float, ...]) -> Floats:
    total = np.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = total * x + coefficient
    return total


def _coefficient(
    square: Floats, terms: tuple[float, ...], exact: Callable[[Floats], Floats]
) -> Floats:
    """Return a coefficient: a polynomial in the *square* of small angles, *exact* of others."""
    theta = np.sqrt(square)
    is_small = theta < _SEAM
    series = _horner(np.where(is_small, square, 0.0), terms)
    return np.where(is_small, series, exact(np.where(is_small, 1.0, theta)))


def _inverse_coefficient(theta: Floats) -> Floats:
    half = 0.5 * theta
    return (1.0 - half * np.cos(half) / np.sin(half)) / theta**2


_SINE_TERMS = (1 / 6, -1 / 120, 1 / 5040, -1 / 362880, 1 / 39916800, -1 / 6227020800)
_INVERSE_TERMS = (
    1 / 12,
    1 / 720,
    1 / 30240,
    1 / 1209600,
    1 / 47900160,
    691 / 1307674368000,
    1 / 74724249600,
)


def left_jacobian(rotation_vector: ArrayLike) -> Floats:
    r"""Return the left Jacobian of the exponential map.

    .. math:: J_l(r) = I + \frac{1 - \cos\theta}{\theta^2} [r]_\times
              + \frac{\theta - \sin\theta}{\theta^3} [r]_\times^2

    (Bullo and Murray, 1995; also Sola, Deray and Atchuthan, 2018, eq. 145.)

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Matrices that take the rate of the rotation vector to the angular velocity in world
        components, shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    r = components(rotation_vector, 3, "rotation_vector")
    square = np.sum(r * r, axis=-1)
    half_sinc = np.sinc(np.sqrt(square) / (2.0 * np.pi))
    first = 0.5 * half_sinc * half_sinc
    second = _coefficient(square, _SINE_TERMS, lambda theta: (theta - np.sin(theta)) / theta**3)
    cross = _skew(r)
    jacobian: Floats = (
        np.eye(3) + first[..., None, None] * cross + second[..., None, None] * (cross @ cross)
    )
    return jacobian


def right_jacobian(rotation_vector: ArrayLike) -> Floats:
    """Return the right Jacobian of the exponential map, the left one of the opposite vector.

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Matrices that take the rate of the rotation vector to the angular velocity in body
        components, shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    return left_jacobian(-components(rotation_vector, 3, "rotation_vector"))


def left_jacobian_inverse(rotation_vector: ArrayLike) -> Floats:
    r"""Return the inverse of the left Jacobian.

    .. math:: J_l^{-1}(r) = I - \tfrac12 [r]_\times
              + \frac{1 - \tfrac{\theta}{2} \cot\tfrac{\theta}{2}}{\theta^2} [r]_\times^2

    It exists for every angle that is not a whole number of turns (other than zero); near a whole
    turn its entries grow without bound, and at one they are not meaningful.

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Matrices that take the angular velocity in world components to the rate of the rotation
        vector, shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    r = components(rotation_vector, 3, "rotation_vector")
    coefficient = _coefficient(np.sum(r * r, axis=-1), _INVERSE_TERMS, _inverse_coefficient)
    cross = _skew(r)
    inverse: Floats = np.eye(3) - 0.5 * cross + coefficient[..., None, None] * (cross @ cross)
    return inverse


def right_jacobian_inverse(rotation_vector: ArrayLike) -> Floats:
    """Return the inverse of the right Jacobian, the left inverse of the opposite vector.

    Args:
        rotation_vector: rotation vectors in radians, shape ``(..., 3)``.

    Returns:
        Matrices that take the angular velocity in body components to the rate of the rotation
        vector, shape ``(..., 3, 3)``.

    Raises:
        ValueError: the last axis does not have length 3.
    """
    return left_jacobian_inverse(-components(rotation_vector, 3, "rotation_vector"))
