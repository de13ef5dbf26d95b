r"""Many quintic joins of two states of motion at once, with what they ask of the device.

A join is the curve ``kks_quintic_hermite``: the cumulative Bernstein product of degree 5 with
orientation, angular velocity and acceleration prescribed at both ends, an extension of the cubic
Hermite curve of Kim, Kim and Shin (1995), sec. 5.2, which they do not give.  With half-angle
increments :math:`w_1 \dots w_5` and duration *T* its velocity would be

.. math:: \omega(u) = \tfrac{10}{T} \sum_{i=1}^5 w_i B_{i-1,4}(u)

if turns commuted.  That decides which durations are worth a look; what is kept is measured on the
curve itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orientd.curves import Curve
from orientd.curves.basis import CumulativeBasis, cumulative_basis
from orientd.curves.cumulative import CumulativeCurve
from orientd.curves.product import product, product_memory
from orientd.planner.fast import kernels
from orientd.rotation import Floats, conjugate, exp_half, log_half, multiply, rotate

_ROUGH, _FINE = 17, 49  # points of a curve that are looked at
_NO_TURN = 1e-300
_UNIT = cumulative_basis(np.repeat([0.0, 1.0], 6), 6)


def _values(points: int) -> Floats:
    u = np.linspace(0.0, 1.0, points)
    return _UNIT.at(np.zeros(points, dtype=np.intp), u)


def _commuting(points: int) -> Floats:
    """Return what turns the increments to velocity, acceleration and jerk, ``(3, points, 5)``."""
    u = np.linspace(0.0, 1.0, points)
    v = 2.0 * _values(points)[1].T
    a = 2.0 * _values(points)[2].T
    # The third derivative of a quintic, from its second at three points: exact for a cubic.
    j = np.gradient(a, u, axis=0, edge_order=2)
    return np.stack([v, a, j])


TO_RATES = np.ascontiguousarray(_commuting(_ROUGH))
"""Velocity, acceleration and jerk of increments over a second at so many points, if turns commuted,
shape ``(3, points, 5)``."""

AT_FINE = _values(_FINE)
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


def rates(w: Floats, durations: Floats, *, with_axes: bool) -> Floats:
    """Return what joins really have of what :func:`rough_rates` estimates."""
    count = len(w) * _FINE
    lengths = np.sqrt(np.einsum("nki,nki->nk", w, w))
    axes = w / np.where(lengths > 0.0, lengths, 1.0)[..., None]
    scale = durations ** -np.arange(3.0)[:, None]
    turns = np.einsum("rkp,nk,rn->rknp", AT_FINE, lengths, scale).reshape(3, 5, count)
    spread = np.repeat(np.moveaxis(axes, 0, -1), _FINE, axis=2)
    base: Floats = np.zeros((4, count))
    base[0] = 1.0
    out: Floats = np.empty((10, count))
    product(base, spread, np.ascontiguousarray(turns), out, product_memory(count))
    omega, alpha = out[4:7].reshape(3, -1, _FINE), out[7:10].reshape(3, -1, _FINE)
    jerk = np.diff(alpha, axis=2) * (_FINE - 1) / durations[:, None]
    rows = [np.moveaxis(x, 0, -1) for x in (omega, alpha, jerk)]
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


def join(q: Floats, w: Floats, duration: float) -> Curve:
    """Return the curve of increments, over ``[0, duration]``.

    Args:
        q: orientation it begins at, shape ``(4,)``.
        w: its increments, shape ``(5, 3)``.
        duration: s.
    """
    return Joins(q[None], w[None], np.array([0.0, duration]))


class Joins(CumulativeCurve):
    """Joins end to end; where they meet, velocity and acceleration are prescribed to be the same.

    Args:
        q: orientations that they begin at, signs continuous, shape ``(n, 4)``.
        w: their increments, shape ``(n, 5, 3)``.
        breaks: when they begin, and when the last one ends, s, shape ``(n + 1,)``.
    """

    def __init__(self, q: Floats, w: Floats, breaks: Floats) -> None:
        count = len(q)
        base, axes, lengths = np.empty((4, count)), np.empty((5, 3, count)), np.empty((5, count))
        values, rates = np.empty((count, 5, 6)), np.empty((count, 5, 5))
        curvatures = np.empty((count, 5, 4))
        basis = CumulativeBasis(breaks, 1 + 5 * np.arange(count), values, rates, curvatures)
        self._set_factors(basis, base, axes, lengths, w.reshape(-1, 3), continuity=2)
        put_joins = kernels().put_joins
        if put_joins is not None:
            units = _UNIT.values[0], _UNIT.rates[0], _UNIT.curvatures[0]
            at_ends: Floats = np.empty((10, 2))
            put_joins(q, w, breaks, *units, base, axes, lengths, values, rates, curvatures, at_ends)
            self._set_ends(at_ends)
            return
        rate = (1.0 / (breaks[1:] - breaks[:-1]))[:, None, None]
        values[:], rates[:] = _UNIT.values, rate * _UNIT.rates
        curvatures[:] = rate * rate * _UNIT.curvatures
        factors = w.transpose(1, 2, 0)
        lengths[:] = np.sqrt((factors * factors).sum(axis=1))
        # A factor that does not turn has any axis.
        axes[:] = factors / np.maximum(lengths, _NO_TURN)[:, None]
        base[:] = q.T


def arrival(q: Floats, w: Floats) -> Floats:
    """Return the quaternion that a join arrives at, with the sign it has there, shape ``(4,)``."""
    for turn in exp_half(w):
        q = multiply(q, turn)
    return q
