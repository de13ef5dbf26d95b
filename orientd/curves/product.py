r"""The cumulative product of Kim, Kim and Shin (1995) over blocks of samples, in NumPy.

.. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_j(t)\bigr)

With :math:`w_j = \theta_j a_j`, :math:`|a_j| = 1`, and :math:`x_j = \theta_j \tilde B_j`, each
factor turns about a fixed axis, and body velocity and acceleration follow factor by factor
(compare Sommer et al., 2020, for the same recursion):

.. math::
    \omega &\leftarrow R_j^T \omega + 2 x_j' a_j \\
    \alpha &\leftarrow R_j^T \alpha + (R_j^T \omega) \times 2 x_j' a_j + 2 x_j'' a_j

where :math:`R_j` is the rotation of :math:`\exp(x_j a_j)`.  Increments are half-angle vectors of
any length: a length above pi is extra winding, which the control quaternions alone do not show.

Everything works in memory handed in: fresh arrays would cost more than the mathematics.
"""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats

TABLE_ROWS = 25
_PRODUCT_ROWS = 51


def product_memory(count: int) -> Floats:
    """Return memory for :func:`product` on blocks of up to *count* samples."""
    return np.empty(_PRODUCT_ROWS * count)


def product(base: Floats, axes: Floats, turns: Floats, out: Floats, memory: Floats) -> None:
    """Write orientation, velocity and acceleration of a product of turns about fixed axes.

    Vectors are held in five rows, x, y, z, x, y, so that the components of a cross product are
    slices.

    Args:
        base: the quaternions before the product, components first, shape ``(4, n)``.
        axes: unit axes of the factors, shape ``(m, 3, n)``.
        turns: half angles of the factors with their first and second time derivatives, shape
            ``(3, m, n)``; overwritten.
        out: receives orientation, body angular velocity and its rate, shape ``(10, n)``.
        memory: from :func:`product_memory`.
    """
    count = base.shape[1]
    rows = memory[: _PRODUCT_ROWS * count].reshape(_PRODUCT_ROWS, count)
    v, e, n = rows[0:5], rows[5:10], rows[10:15]
    motion, twist = rows[15:25].reshape(2, 5, count), rows[25:35].reshape(2, 5, count)
    added, some = rows[35:41].reshape(2, 3, count), rows[41:47].reshape(2, 3, count)
    w, c, s = rows[47:50]
    turns[1:] *= 2.0
    w[:], v[:3] = base[0], base[1:]
    for j, axis in enumerate(axes):
        np.cos(turns[0, j], out=c)
        np.sin(turns[0, j], out=s)
        np.multiply(s, axis, out=e[:3])
        e[3:], v[3:] = e[:2], v[:2]
        # The product with (c, e): w c - v.e, and v c + w e + v x e.
        vector = _cross(v, e, added[0], some[0])
        vector += np.multiply(w, e[:3], out=some[0])
        w *= c
        w -= np.einsum("in,in->n", v[:3], e[:3], out=s)
        v[:3] *= c
        v[:3] += vector
        np.multiply(turns[1:, j, None], axis, out=added)
        if j == 0:
            motion[:, :3] = added
            continue
        # Both vectors turned back: u + c t + t x e with t = 2 u x e.
        motion[:, 3:] = motion[:, :2]
        _cross(motion, e, twist[:, :3], some)
        twist[:, :3] *= 2.0
        twist[:, 3:] = twist[:, :2]
        motion[:, :3] += np.multiply(c, twist[:, :3], out=some)
        _add_cross(twist, e, motion[:, :3], some)
        omega = motion[0]
        omega[3:] = omega[:2]
        n[:3], n[3:] = added[0], added[0, :2]
        _add_cross(omega, n, added[1], some[0])
        motion[:, :3] += added
    out[0], out[1:4] = w, v[:3]
    out[4:7], out[7:10] = motion[0, :3], motion[1, :3]


def _cross(a: Floats, b: Floats, out: Floats, spare: Floats) -> Floats:
    """Write cross products of vectors held in five rows."""
    np.multiply(a[..., 1:4, :], b[..., 2:5, :], out=out)
    out -= np.multiply(a[..., 2:5, :], b[..., 1:4, :], out=spare)
    return out


def _add_cross(a: Floats, b: Floats, out: Floats, spare: Floats) -> None:
    """Add cross products of vectors held in five rows to what is there."""
    out += np.multiply(a[..., 1:4, :], b[..., 2:5, :], out=spare)
    out -= np.multiply(a[..., 2:5, :], b[..., 1:4, :], out=spare)
