r"""Angular acceleration or torque along a cumulative product, and how the increments change it.

With :math:`\varphi_j = 2 b_j w_j` the turn of factor *j*, :math:`R_j` its rotation and
:math:`u_j = 2 b_j' w_j`, body velocity and acceleration follow factor by factor,

.. math::
    \bar\omega = R_j^T \omega, \quad \bar\alpha = R_j^T \alpha, \qquad
    \omega \leftarrow \bar\omega + u_j, \quad
    \alpha \leftarrow \bar\alpha + \bar\omega \times u_j + 2 b_j'' w_j

and so do their derivatives: with the right Jacobian :math:`J_r(\varphi_j)`, which takes a change of
:math:`\varphi_j` to a turn of the body,

.. math::
    \partial\omega / \partial w_j &= 2 b_j [\bar\omega]_\times J_r + 2 b_j' I \\
    \partial\alpha / \partial w_j &= 2 b_j \bigl([\bar\alpha]_\times
        - [u_j]_\times [\bar\omega]_\times\bigr) J_r + 2 b_j' [\bar\omega]_\times + 2 b_j'' I

after factor *j*, which the later factors carry on to the end of the product.  Sommer, Usenko,
Schubert, Demmel and Cremers (2020), "Efficient Derivative Computation for Cumulative B-Splines on
Lie Groups", sec. 4; there a change of all control quaternions is carried along, here only that of
the increments, which are all that an acceleration depends on.
"""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats, right_jacobian


def torques(increments: Floats, weights: Floats, inertia: Floats | None) -> tuple[Floats, Floats]:
    """Return torques and their derivatives with respect to the increments.

    Args:
        increments: half-angle vectors of the factors, shape ``(n, m, 3)``.
        weights: values, first and second time derivatives of the basis functions of the factors,
            shape ``(3, m, n)``.
        inertia: kg m^2 in the body frame, shape ``(3, 3)``; without it the angular acceleration
            takes the place of the torque.

    Returns:
        Torques in N m, or accelerations in rad/s^2, shape ``(n, 3)``, and their derivatives by
        half-angle vectors, shape ``(n, 3, m, 3)``.
    """
    count, factors, _ = increments.shape
    value, rate, curvature = 2.0 * weights[..., None, None]
    turns = value[..., 0] * np.moveaxis(increments, 1, 0)
    jacobians = right_jacobian(turns)
    # exp(-r) = I - [r] J_r(r): the turn back needs no sines of its own.
    backs = np.eye(3) - skew(turns) @ jacobians
    spins = rate[..., 0] * np.moveaxis(increments, 1, 0)
    spin_matrices = skew(spins)
    omega, alpha = np.zeros((count, 3, 1)), np.zeros((count, 3, 1))
    by_omega, by_alpha = [], []
    for j in range(factors):
        omega, alpha = backs[j] @ omega, backs[j] @ alpha
        cross = skew(omega[..., 0])
        spin = spin_matrices[j]
        jacobian = value[j] * jacobians[j]
        by_omega.append(cross @ jacobian + rate[j] * np.eye(3))
        by_alpha.append(
            (skew(alpha[..., 0]) - spin @ cross) @ jacobian
            + rate[j] * cross
            + curvature[j] * np.eye(3)
        )
        alpha = alpha + cross @ spins[j, ..., None] + curvature[j] * increments[:, j, :, None]
        omega = omega + spins[j, ..., None]
    ahead, bent = np.eye(3), np.zeros((3, 3))
    if inertia is not None:
        momentum = inertia @ omega
        bent = skew(omega[..., 0]) @ inertia - skew(momentum[..., 0])
        ahead = inertia
        alpha = inertia @ alpha + np.cross(omega, momentum, axis=1)
    derivatives = np.empty((count, 3, factors, 3))
    # What is after factor j takes (d omega, d alpha) to bent d omega + ahead d alpha.
    for j in reversed(range(factors)):
        derivatives[:, :, j] = ahead @ by_alpha[j] + bent @ by_omega[j]
        if j > 0:
            bent = (bent - ahead @ spin_matrices[j]) @ backs[j]
            ahead = ahead @ backs[j]
    return alpha[..., 0], derivatives


def skew(vectors: Floats) -> Floats:
    """Return the matrices of cross products ``v x``, shape ``(..., 3, 3)``."""
    matrices: Floats = np.zeros((*vectors.shape, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrices[..., 0, 1], matrices[..., 0, 2], matrices[..., 1, 2] = -z, y, -x
    matrices[..., 1, 0], matrices[..., 2, 0], matrices[..., 2, 1] = z, -y, x
    return matrices
