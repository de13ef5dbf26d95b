"""Exact differentiation of quaternion constructions: second-order jets over arrays of samples.

A jet carries a quantity with its first and second derivatives with respect to time.  A curve that
is a composition of products, exponentials, logarithms and slerps has no short closed form for its
angular velocity and acceleration, but every step of it has one for jets; composed, they are the
derivatives of the construction itself, to rounding.  No difference quotient is involved.

The leading axes are samples; the last axis of a vector or quaternion jet is its components.  A
scalar jet has no component axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats, conjugate, exp_half, multiply

# acos(1 - y) / sqrt(y (2 - y)) = sum n! / (2n + 1)!! y^n, and sin(sqrt z) / sqrt z.
_ANGLE_OVER_SINE = np.array(
    [math.factorial(n) / math.prod(range(1, 2 * n + 2, 2)) for n in range(16)]
)
_SINC = np.array([(-1.0) ** n / math.factorial(2 * n + 1) for n in range(10)])
_SMALL_VERSINE = 0.125
_SMALL_SQUARE = 0.5


@dataclass(frozen=True, slots=True)
class Jet:
    """A quantity with its first two time derivatives, three arrays of one shape."""

    value: Floats
    first: Floats
    second: Floats

    def __add__(self, other: Jet) -> Jet:
        return Jet(self.value + other.value, self.first + other.first, self.second + other.second)

    def __sub__(self, other: Jet) -> Jet:
        return Jet(self.value - other.value, self.first - other.first, self.second - other.second)

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __mul__(self, other: Jet) -> Jet:
        """Multiply component by component."""
        return Jet(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value + 2.0 * self.first * other.first + self.value * other.second,
        )

    def times(self, factor: ArrayLike) -> Jet:
        """Multiply by a quantity that does not change with time."""
        factor = np.asarray(factor, dtype=np.float64)
        return Jet(self.value * factor, self.first * factor, self.second * factor)

    def widened(self) -> Jet:
        """Give a scalar jet a component axis, to scale vectors with it."""
        return Jet(self.value[..., None], self.first[..., None], self.second[..., None])

    def composed(self, value: Floats, first: Floats, second: Floats) -> Jet:
        """Apply a function, given by its value and derivatives at the jet's value."""
        return Jet(
            value, first * self.first, second * self.first * self.first + first * self.second
        )


def constant(value: ArrayLike) -> Jet:
    """Return the jet of a quantity that does not change."""
    array = np.asarray(value, dtype=np.float64)
    zero = np.zeros_like(array)
    return Jet(array, zero, zero)


def linear(value: ArrayLike, rate: ArrayLike) -> Jet:
    """Return the jet of a quantity with constant rate."""
    array = np.asarray(value, dtype=np.float64)
    slope = np.asarray(rate, dtype=np.float64)
    return Jet(array, np.broadcast_to(slope, array.shape), np.zeros_like(array))


def dot(a: Jet, b: Jet) -> Jet:
    """Return the scalar product of two vector jets."""
    return Jet(
        np.sum(a.value * b.value, axis=-1),
        np.sum(a.first * b.value + a.value * b.first, axis=-1),
        np.sum(a.second * b.value + 2.0 * a.first * b.first + a.value * b.second, axis=-1),
    )


def product(p: Jet, q: Jet) -> Jet:
    """Return the quaternion product of two jets (Leibniz' rule, the order kept)."""
    return Jet(
        multiply(p.value, q.value),
        multiply(p.first, q.value) + multiply(p.value, q.first),
        multiply(p.second, q.value)
        + 2.0 * multiply(p.first, q.first)
        + multiply(p.value, q.second),
    )


def inverse(q: Jet) -> Jet:
    """Return the inverse of a unit quaternion jet, its conjugate."""
    return Jet(conjugate(q.value), conjugate(q.first), conjugate(q.second))


def exponential(v: Jet) -> Jet:
    r"""Return the quaternion exponential of a half-angle vector jet.

    With :math:`z = v \cdot v` both :math:`\cos\sqrt z` and :math:`S = \sin\sqrt z / \sqrt z` are
    entire functions of *z*, with :math:`\cos' = -S/2`, :math:`S' = (\cos - S)/2z` and
    :math:`S'' = -(S/2 + 3S')/2z`; below 1/2 their series takes over from the quotients.
    """
    z = dot(v, v)
    cosine, sinc, first, second = _entire_functions(z.value)
    scalar = z.composed(cosine, -0.5 * sinc, -0.5 * first)
    vector = z.composed(sinc, first, second).widened() * v
    return Jet(
        np.concatenate([scalar.value[..., None], vector.value], axis=-1),
        np.concatenate([scalar.first[..., None], vector.first], axis=-1),
        np.concatenate([scalar.second[..., None], vector.second], axis=-1),
    )


def _entire_functions(z: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    is_small = z < _SMALL_SQUARE
    root = np.sqrt(z)
    cosine: Floats = np.cos(root)
    safe = np.where(is_small, 1.0, z)
    sinc = np.sin(root) / np.sqrt(safe)
    first = (cosine - sinc) / (2.0 * safe)
    second = -(0.5 * sinc + 3.0 * first) / (2.0 * safe)
    series = _series(_SINC, np.where(is_small, z, 0.0))
    return (
        cosine,
        np.where(is_small, series[0], sinc),
        np.where(is_small, series[1], first),
        np.where(is_small, series[2], second),
    )


def logarithm(q: Jet) -> Jet:
    r"""Return the principal logarithm of a unit quaternion jet, a half-angle vector jet.

    The quaternion is taken with the sign it has, so lengths go up to :math:`\pi`, where the
    logarithm is singular.  With :math:`c` the scalar part, :math:`s` the length of the vector part
    and :math:`f = \theta / s`, the derivatives are :math:`f' = (c f - 1)/s^2` and
    :math:`f'' = (f + 3 c f')/s^2`; near :math:`c = 1` the series in :math:`y = 1 - c`,
    :math:`f = \sum n!/(2n+1)!!\, y^n`, takes over, so that coincident points are exact.
    """
    c = q.value[..., 0]
    square = np.sum(q.value[..., 1:] * q.value[..., 1:], axis=-1)
    angle = np.arctan2(np.sqrt(square), c)
    versine = np.where(c > 0.0, square / (1.0 + np.abs(c)), 1.0)
    is_small = versine < _SMALL_VERSINE
    safe = np.where(is_small, 1.0, square)
    factor = angle / np.sqrt(safe)
    first = (c * factor - 1.0) / safe
    second = (factor + 3.0 * c * first) / safe
    series = _series(_ANGLE_OVER_SINE, np.where(is_small, versine, 0.0))
    scalar = Jet(c, q.first[..., 0], q.second[..., 0]).composed(
        np.where(is_small, series[0], factor),
        np.where(is_small, -series[1], first),
        np.where(is_small, series[2], second),
    )
    vector = Jet(q.value[..., 1:], q.first[..., 1:], q.second[..., 1:])
    return scalar.widened() * vector


def _series(coefficients: Floats, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Return a polynomial with its first two derivatives (Horner's rule)."""
    value, first, second = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    for coefficient in coefficients[::-1]:
        second = second * x + first
        first = first * x + value
        value = value * x + coefficient
    return value, first, 2.0 * second


def geodesic(start: Floats, step: Floats, u: Jet) -> Jet:
    r"""Return the jet of :math:`p \exp(u\, w)`, a great arc between fixed points.

    A rotation about a fixed axis, so :math:`q' = u' q w` and :math:`q'' = u'' q w - u'^2 |w|^2 q`.

    Args:
        start: quaternions *p*, shape ``(..., 4)``.
        step: half-angle vectors *w*, shape ``(..., 3)``.
        u: scalar jet.
    """
    q = multiply(start, exp_half(u.value[..., None] * step))
    axis = np.concatenate([np.zeros((*step.shape[:-1], 1)), step], axis=-1)
    along = multiply(q, axis)
    square = np.sum(step * step, axis=-1)
    return Jet(
        q,
        u.first[..., None] * along,
        u.second[..., None] * along - (u.first * u.first * square)[..., None] * q,
    )


def slerp(p: Jet, q: Jet, u: Jet) -> Jet:
    r"""Return :math:`p \exp(u \log(p^{-1} q))` with everything moving, any real *u*, no sign flip.

    Where *p* and *q* are antipodal the great arc between them is not defined and the derivatives
    come out infinite or not a number.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        step = logarithm(product(inverse(p), q))
        return product(p, exponential(u.widened() * step))


def unit(c: Jet) -> Jet:
    r"""Return a vector jet divided by its length, :math:`c / \|c\|`."""
    square = dot(c, c)
    n = square.value
    length = np.sqrt(n)
    inverse_length = square.composed(1.0 / length, -0.5 / (n * length), 0.75 / (n * n * length))
    return inverse_length.widened() * c


def rates(q: Jet) -> tuple[Floats, Floats, Floats]:
    r"""Return orientation, angular velocity and angular acceleration of a unit quaternion jet.

    .. math:: \Omega = 2\,\mathrm{vec}(q^* q'), \qquad \dot\Omega = 2\,\mathrm{vec}(q^* q'')

    Returns:
        ``q`` of shape ``(..., 4)``, normalised to rounding; body rates in rad/s and rad/s^2, of
        shape ``(..., 3)``.
    """
    length = np.sqrt(np.sum(q.value * q.value, axis=-1, keepdims=True))
    orientation: Floats = q.value / length
    back = conjugate(orientation)
    omega_body: Floats = 2.0 * multiply(back, q.first)[..., 1:] / length
    alpha_body: Floats = 2.0 * multiply(back, q.second)[..., 1:] / length
    return orientation, omega_body, alpha_body
