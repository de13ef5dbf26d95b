"""Joins of two states of motion, many at once, with what they ask of the device.

The formulas are those of ``orientd/kernels/c/connectors.h``.  If turns commuted the velocity of a
join of duration *T* would be ``10 / T`` times the sum of its increments, each times a Bernstein
polynomial of degree 4.  That decides which durations are worth a look; what is kept is measured on
the curve itself.
"""

from __future__ import annotations

from math import comb
from typing import NamedTuple

import numpy as np

from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply, rotate

_ROUGH, _FINE = 17, 49  # points of a curve that are looked at


def bernstein(degree: int, u: Floats) -> Floats:
    """Return the Bernstein polynomials of a degree, with a zero on either side, row by row."""
    rows = [comb(degree, j) * u**j * (1.0 - u) ** (degree - j) for j in range(degree + 1)]
    return np.array([0.0 * u, *rows, 0.0 * u])


def basis(u: Floats) -> Floats:
    """Return the five cumulative functions with two derivatives by *u*, shape ``(3, 5, n)``."""
    five, four, three = (bernstein(degree, u) for degree in (5, 4, 3))
    values = np.cumsum(five[::-1], axis=0)[::-1][2:7]
    return np.array([values, 5.0 * four[1:6], 20.0 * (three[:5] - three[1:6])])


def _commuting(points: int) -> Floats:
    """Return what turns the increments to velocity, acceleration and jerk, ``(3, points, 5)``."""
    u = np.linspace(0.0, 1.0, points)
    _, v, a = 2.0 * basis(u).transpose(0, 2, 1)
    return np.stack([v, a, np.gradient(a, u, axis=0, edge_order=2)])


TO_RATES = _commuting(_ROUGH)
"""Velocity, acceleration and jerk of increments over a second, shape ``(3, points, 5)``."""

AT_FINE = basis(np.linspace(0.0, 1.0, _FINE))
"""Basis functions with two derivatives at more points, shape ``(3, 5, points)``."""


class Ends(NamedTuple):
    """States at one end of several joins.

    Attributes:
        q: orientations, shape ``(n, 4)``.
        omega: angular velocities, body frame, rad/s, shape ``(n, 3)``.
        alpha: angular accelerations in body components, rad/s^2, shape ``(n, 3)``.
    """

    q: Floats
    omega: Floats
    alpha: Floats

    def at(self, index: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Ends:
        """Return the states of some of the joins."""
        return Ends(self.q[index], self.omega[index], self.alpha[index])

    def one(self, index: int) -> Ends:
        """Return one of the states, shapes ``(4,)`` and ``(3,)``."""
        return Ends(self.q[index], self.omega[index], self.alpha[index])


def increments(first: Ends, last: Ends, durations: Floats) -> Floats:
    """Return half-angle increments of joins, both ways round each.

    Args:
        first: where they begin, *n* states.
        last: where they end, *n* states.
        durations: s, shape ``(n,)``.

    Returns:
        Shape ``(2, n, 5, 3)``; of the two ways round, the one with the smaller middle increment
        comes first.
    """
    h = durations[:, None]
    bend = h * h / 40.0
    w: Floats = np.empty((2, len(durations), 5, 3))
    w[:, :, 0] = h / 10.0 * first.omega
    w[:, :, 1] = w[0, :, 0] + bend * first.alpha
    w[:, :, 4] = h / 10.0 * last.omega
    e = exp_half(w[0][:, [0, 1, 4]])
    w[:, :, 3] = rotate(e[:, 2], w[0, :, 4] - bend * last.alpha)
    begun = multiply(first.q, multiply(e[:, 0], e[:, 1]))
    undone = multiply(last.q, conjugate(multiply(exp_half(w[0, :, 3]), e[:, 2])))
    middle = multiply(conjugate(begun), undone)
    middle = np.where(middle[:, :1] < 0.0, -middle, middle)
    w[0, :, 2] = log_half(middle)
    w[1, :, 2] = log_half(-middle)
    return w


def rough_rates(w: Floats, durations: Floats, *, with_axes: bool) -> Floats:
    """Return the largest velocity, acceleration and jerk of joins as if turns commuted.

    Args:
        w: increments, shape ``(n, 5, 3)``.
        durations: s, shape ``(n,)``.
        with_axes: whether to return sizes of the components, too.

    Returns:
        Norms, and components behind them if asked for, shape ``(3, 1 or 4, n)``.
    """
    rates = np.matmul(TO_RATES.reshape(-1, 5), w).reshape(len(w), 3, _ROUGH, 3)
    largest = _largest(rates, "nrpi,nrpi->nrp", 2, with_axes=with_axes)
    found: Floats = np.moveaxis(largest, 0, -1) / durations ** np.array([[[1.0]], [[2.0]], [[3.0]]])
    return found


def sampled(q: Floats, w: Floats, durations: Floats, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Return orientations, velocities and accelerations of joins, factor by factor.

    Args:
        q: where they begin, shape ``(n, 4)``.
        w: increments, shape ``(n, 5, 3)``.
        durations: s, shape ``(n,)``.
        at: from :func:`basis` at some points.

    Returns:
        Shapes ``(n, points, 4)``, ``(n, points, 3)`` and ``(n, points, 3)``.
    """
    h = durations[:, None, None]
    here = np.repeat(q[:, None], at.shape[2], axis=1)
    omega, alpha = np.zeros((2, *here.shape[:2], 3))
    for k in range(5):
        value, rate, bend = (row[k][:, None] * w[:, None, k] for row in at)
        turn = exp_half(value)
        own = 2.0 * rate / h
        here, omega = multiply(here, turn), rotate(conjugate(turn), omega)
        alpha = rotate(conjugate(turn), alpha) + np.cross(omega, own) + 2.0 * bend / h**2
        omega = omega + own
    return here, omega, alpha


def rates(w: Floats, durations: Floats, *, with_axes: bool) -> Floats:
    """Return what joins really have of what :func:`rough_rates` estimates."""
    base = np.tile([1.0, 0.0, 0.0, 0.0], (len(w), 1))
    _, omega, alpha = sampled(base, w, durations, AT_FINE)
    jerk = np.diff(alpha, axis=1) * (_FINE - 1) / durations[:, None, None]
    rows = (omega, alpha, jerk)
    return np.stack([_largest(x, "npi,npi->np", 1, with_axes=with_axes).T for x in rows])


def _peaks(values: Floats) -> Floats:
    """Return the largest of *values* along the last axis, by a parabola where it lies between."""
    middle = np.clip(np.argmax(values, axis=-1), 1, values.shape[-1] - 2)[..., None]
    before, here, after = (
        np.take_along_axis(values, middle + side, axis=-1)[..., 0] for side in (-1, 0, 1)
    )
    bend = 2.0 * here - before - after
    is_peak = (here >= before) & (here >= after) & (bend > 0.0)
    rise = np.divide((after - before) ** 2, 8.0 * bend, out=np.zeros_like(here), where=is_peak)
    peaks: Floats = np.maximum(values.max(axis=-1), here + rise)
    return peaks


def _largest(vectors: Floats, squares: str, points: int, *, with_axes: bool) -> Floats:
    norms = np.sqrt(_peaks(np.einsum(squares, vectors, vectors)))[..., None]
    if not with_axes:
        return np.asarray(norms)
    return np.concatenate([norms, np.abs(vectors).max(axis=points)], axis=-1)


def arrival(q: Floats, w: Floats) -> Floats:
    """Return the quaternion that a join arrives at, with the sign it has there, shape ``(4,)``."""
    for turn in exp_half(w):
        q = multiply(q, turn)
    return q
