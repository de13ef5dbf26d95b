r"""The cumulative product of Kim, Kim and Shin (1995), evaluated over blocks of samples.

.. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_j(t)\bigr)

With :math:`w_j = \theta_j a_j`, :math:`|a_j| = 1`, and :math:`x_j = \theta_j \tilde B_j`, each
factor turns about a fixed axis, and body velocity and acceleration follow factor by factor
(compare Sommer et al., 2020, for the same recursion):

.. math::
    \omega &\leftarrow R_j^T \omega + 2 x_j' a_j \\
    \alpha &\leftarrow R_j^T \alpha + (R_j^T \omega) \times 2 x_j' a_j + 2 x_j'' a_j

where :math:`R_j` is the rotation of :math:`\exp(x_j a_j)`.  Increments are half-angle vectors of
any length: a length above pi is extra winding, which the control quaternions alone do not show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import CumulativeBasis, Indices
from orientd.curves.contract import Curve, Samples, check_out
from orientd.rotation import Floats

BLOCK = 2048
"""Samples worked on at a time, so that intermediate results stay in the cache."""


def product(base: Floats, axes: Floats, turns: Floats, out: Floats) -> None:
    """Write orientation, velocity and acceleration of a product of turns about fixed axes.

    Args:
        base: the quaternions before the product, components first, shape ``(4, n)``.
        axes: unit axes of the factors, shape ``(m, 3, n)``.
        turns: half angles of the factors with their first and second time derivatives, shape
            ``(3, m, n)``.
        out: receives orientation, body angular velocity and its rate, shape ``(10, n)``.
    """
    cosines, sines = np.cos(turns[0]), np.sin(turns[0])
    rates, curvatures = 2.0 * turns[1], 2.0 * turns[2]
    vectors = [axis * sine for axis, sine in zip(axes, sines, strict=True)]
    qw, qx, qy, qz = _multiply(tuple(base), cosines[0], vectors[0])
    ox, oy, oz = rates[0] * axes[0]
    px, py, pz = curvatures[0] * axes[0]
    for j in range(1, len(axes)):
        qw, qx, qy, qz = _multiply((qw, qx, qy, qz), cosines[j], vectors[j])
        ox, oy, oz = _turned_back(cosines[j], vectors[j], (ox, oy, oz))
        px, py, pz = _turned_back(cosines[j], vectors[j], (px, py, pz))
        nx, ny, nz = rates[j] * axes[j]
        mx, my, mz = curvatures[j] * axes[j]
        px, py, pz = (
            px + mx + (oy * nz - oz * ny),
            py + my + (oz * nx - ox * nz),
            pz + mz + (ox * ny - oy * nx),
        )
        ox, oy, oz = ox + nx, oy + ny, oz + nz
    for row, component in enumerate((qw, qx, qy, qz, ox, oy, oz, px, py, pz)):
        out[row] = component


def _multiply(q: Sequence[Floats], c: Floats, e: Floats) -> tuple[Floats, ...]:
    """Return the components of the product of *q* and the quaternion ``(c, e)``."""
    qw, qx, qy, qz = q
    ex, ey, ez = e
    return (
        qw * c - qx * ex - qy * ey - qz * ez,
        qw * ex + qx * c + qy * ez - qz * ey,
        qw * ey - qx * ez + qy * c + qz * ex,
        qw * ez + qx * ey - qy * ex + qz * c,
    )


def _turned_back(c: Floats, e: Floats, v: Sequence[Floats]) -> tuple[Floats, Floats, Floats]:
    """Return the components of *v* rotated by the inverse of the unit quaternion ``(c, e)``."""
    ex, ey, ez = e
    vx, vy, vz = v
    tx = 2.0 * (vy * ez - vz * ey)
    ty = 2.0 * (vz * ex - vx * ez)
    tz = 2.0 * (vx * ey - vy * ex)
    return (
        vx + c * tx + (ty * ez - tz * ey),
        vy + c * ty + (tz * ex - tx * ez),
        vz + c * tz + (tx * ey - ty * ex),
    )


class CumulativeCurve(Curve):
    """A cumulative product over a B-spline basis: what the families of Kim, Kim and Shin share.

    Args:
        basis: the cumulative basis functions that vary on each span.
        controls: control quaternions, shape ``(n + 1, 4)``, the signs as the product needs them.
        increments: half-angle vectors from each control quaternion to the next, ``(n, 3)``.
        continuity: what holds at the knots.
    """

    def __init__(
        self,
        *,
        basis: CumulativeBasis,
        controls: Floats,
        increments: Floats,
        continuity: int,
    ) -> None:
        super().__init__(knots=basis.breaks, continuity=continuity)
        self._basis = basis
        self._increments = increments
        window = basis.first[:, None] - 1 + np.arange(basis.values.shape[1])
        lengths = np.sqrt(np.sum(increments**2, axis=-1))
        axes = increments / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        self._base = np.ascontiguousarray(controls[window[:, 0]].T)
        self._axes = np.ascontiguousarray(np.moveaxis(axes[window], 0, -1))
        self._lengths = np.ascontiguousarray(lengths[window].T)

    @property
    def increments(self) -> Floats:
        """Half-angle vectors from each control quaternion to the next; read only, ``(n, 3)``."""
        view = self._increments.view()
        view.setflags(write=False)
        return view

    def evaluate(self, times: ArrayLike, *, out: Floats | None = None) -> Samples:
        """See :meth:`Curve.evaluate`."""
        instants = np.asarray(times, dtype=np.float64)
        flat = self._inside(instants.reshape(-1))
        if out is None:
            out = np.empty((10, len(flat)))
        else:
            check_out(out, len(flat))
        for begin in range(0, len(flat), BLOCK):
            block = flat[begin : begin + BLOCK]
            self._fill(self._segments(block), block, out[:, begin : begin + BLOCK])
        q, omega_body, alpha_body = out[0:4].T, out[4:7].T, out[7:10].T
        if instants.ndim == 1:
            return q, omega_body, alpha_body
        shape = instants.shape
        return (
            q.reshape(*shape, 4),
            omega_body.reshape(*shape, 3),
            alpha_body.reshape(*shape, 3),
        )

    def _sample(self, times: Floats) -> Samples:
        return self.evaluate(times)

    def _fill(self, span: Indices, times: Floats, out: Floats) -> None:
        turns = self._basis.at(span, times) * self._lengths.take(span, axis=1)
        product(self._base.take(span, axis=1), self._axes.take(span, axis=2), turns, out)
