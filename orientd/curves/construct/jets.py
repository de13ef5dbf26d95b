"""Exact differentiation of quaternion constructions: second-order jets over arrays of samples.

A jet carries a quantity with its first and second derivatives with respect to time.  A curve that
is a composition of products, exponentials, logarithms and slerps has no short closed form for its
angular velocity and acceleration, but every step of it has one for jets; composed, they are the
derivatives of the construction itself, to rounding.  No difference quotient is involved.  What has
transcendental functions in it is in ``orientd/kernels/c/jets.c``.

The leading axes are samples; the last axis of a vector or quaternion jet is its components.  A
scalar jet has no component axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd import kernels
from orientd.rotation import Floats, conjugate, multiply


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


def exponential(v: Jet) -> Jet:
    """Return the quaternion exponential of a half-angle vector jet."""
    out = np.empty((3, v.value.size // 3, 4))
    kernels.jet_exponential(*_rows(v, 3), out)
    return _jet(out, v.value.shape[:-1])


def logarithm(q: Jet) -> Jet:
    r"""Return the principal logarithm of a unit quaternion jet, a half-angle vector jet.

    The quaternion is taken with the sign it has, so lengths go up to :math:`\pi`, where the
    logarithm is singular; the jets of quaternions that coincide with 1 are exact.
    """
    out = np.empty((3, q.value.size // 4, 3))
    kernels.jet_logarithm(*_rows(q, 4), out)
    return _jet(out, q.value.shape[:-1])


def geodesic(start: Floats, step: Floats, u: Jet) -> Jet:
    r"""Return the jet of :math:`p \exp(u\, w)`, a great arc between fixed points.

    Args:
        start: quaternions *p*, shape ``(..., 4)``.
        step: half-angle vectors *w*, shape ``(..., 3)``.
        u: scalar jet.
    """
    out = np.empty((3, u.value.size, 4))
    from_, along = (_contiguous(rows, width) for rows, width in ((start, 4), (step, 3)))
    kernels.jet_geodesic(from_, along, *_scalars(u), out)
    return _jet(out, u.value.shape)


def slerp(p: Jet, q: Jet, u: Jet) -> Jet:
    r"""Return :math:`p \exp(u \log(p^{-1} q))` with everything moving, any real *u*, no sign flip.

    Where *p* and *q* are antipodal the great arc between them is not defined and the derivatives
    come out infinite or not a number.
    """
    out = np.empty((3, u.value.size, 4))
    kernels.jet_slerp(*_rows(p, 4), *_rows(q, 4), *_scalars(u), out)
    return _jet(out, u.value.shape)


def _contiguous(rows: Floats, width: int) -> Floats:
    return np.ascontiguousarray(rows).reshape(rows.size // width, width)


def _rows(jet: Jet, width: int) -> tuple[Floats, Floats, Floats]:
    return (
        _contiguous(jet.value, width),
        _contiguous(jet.first, width),
        _contiguous(jet.second, width),
    )


def _scalars(jet: Jet) -> tuple[Floats, Floats, Floats]:
    value, first, second = _rows(jet, 1)
    return value[:, 0], first[:, 0], second[:, 0]


def _jet(out: Floats, shape: tuple[int, ...]) -> Jet:
    return Jet(*out.reshape(3, *shape, out.shape[-1]))


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
